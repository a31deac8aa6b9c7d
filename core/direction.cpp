#include "core/direction.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/error.h"
#include "core/text.h"

namespace lightstage::core {

namespace {

struct SineCosine {
  double sine, cosine;
};

// Exact at multiples of 90 degrees, so that the poles and axes come out as such: remquo reduces without
// rounding.
SineCosine sine_cosine_degrees(double degrees) {
  int quadrant = 0;
  const double rest = radians_from_degrees(std::remquo(degrees, 90.0, &quadrant));
  const double s = std::sin(rest), c = std::cos(rest);
  switch (static_cast<unsigned>(quadrant) % 4U) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

std::string text_of(Vec3 v) {
  return "(" + number_text(v.x) + ", " + number_text(v.y) + ", " + number_text(v.z) + ")";
}

}  // namespace

Direction Direction::from_vector(Vec3 v) {
  if (!std::isfinite(v.x) || !std::isfinite(v.y) || !std::isfinite(v.z))
    throw BadInput("direction " + text_of(v) + " is not finite");
  const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
  if (largest == 0) throw BadInput("direction (0, 0, 0) has no length; give a vector towards the light");
  // Scaling by a power of two is exact, also from denormals; afterwards squares neither overflow nor vanish.
  const int exponent = std::ilogb(largest);
  const Vec3 scaled{std::scalbn(v.x, -exponent), std::scalbn(v.y, -exponent), std::scalbn(v.z, -exponent)};
  return Direction(scaled / std::sqrt(dot(scaled, scaled)));
}

Direction Direction::from_longitude_latitude_degrees(double longitude_degrees, double latitude_degrees) {
  if (!std::isfinite(longitude_degrees) || !(std::abs(latitude_degrees) <= 90))
    throw BadInput("longitude " + number_text(longitude_degrees) + ", latitude " + number_text(latitude_degrees) +
                   " degrees is not a direction; latitude runs from -90 to 90");
  const SineCosine longitude = sine_cosine_degrees(longitude_degrees);
  const SineCosine latitude = sine_cosine_degrees(latitude_degrees);
  return from_vector({latitude.cosine * longitude.sine, latitude.sine, latitude.cosine * longitude.cosine});
}

double Direction::longitude_degrees() const {
  if (v_.x == 0 && v_.z == 0) return 0;
  const double degrees = degrees_from_radians(std::atan2(v_.x, v_.z));
  return degrees == -180 ? 180 : degrees;
}

double Direction::latitude_degrees() const {
  return degrees_from_radians(std::atan2(v_.y, std::hypot(v_.x, v_.z)));
}

double angle_radians(const Direction& a, const Direction& b) {
  return 2 * std::atan2(norm(a.vec() - b.vec()), norm(a.vec() + b.vec()));
}

Direction parse_direction(const std::string& text) {
  const auto fail = [&](const std::string& problem) {
    return BadInput("'" + text + "' is not a direction: " + problem + "; write x,y,z or longitude,latitude in degrees");
  };
  std::vector<double> numbers;
  for (const std::string_view piece : split(text, ',')) {
    const std::optional<double> number = parse_number(trim(piece));
    if (!number) throw fail("'" + std::string(trim(piece)) + "' is not a number");
    numbers.push_back(*number);
  }
  if (numbers.size() != 2 && numbers.size() != 3) throw fail("it has " + std::to_string(numbers.size()) + " numbers");
  try {
    return numbers.size() == 3 ? Direction::from_vector({numbers[0], numbers[1], numbers[2]})
                               : Direction::from_longitude_latitude_degrees(numbers[0], numbers[1]);
  } catch (const BadInput& problem) {
    throw fail(problem.what());
  }
}

double radians_from_degrees(double degrees) {
  return degrees * (std::numbers::pi / 180);
}
double degrees_from_radians(double radians) {
  return radians * (180 / std::numbers::pi);
}

}  // namespace lightstage::core
