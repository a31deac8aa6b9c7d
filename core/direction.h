// A direction: the unit vector from the subject towards a light, in the stage frame.
#pragma once

#include <string>

#include "core/vec3.h"

namespace lightstage::core {

class Direction {
 public:
  // +z, towards the primary camera.
  Direction() = default;

  // Normalises `v`. Throws BadInput when v is zero or not finite. Vectors of any finite length are taken,
  // down to denormals, without loss.
  static Direction from_vector(Vec3 v);

  // Longitude 0 is +z, +90 degrees is +x; latitude +90 degrees is +y: the angles of the lat-long environment
  // map.
  static Direction from_longitude_latitude_degrees(double longitude_degrees, double latitude_degrees);

  Vec3 vec() const { return v_; }
  double x() const { return v_.x; }
  double y() const { return v_.y; }
  double z() const { return v_.z; }
  double longitude_degrees() const;  // in (-180, 180]; 0 at the poles
  double latitude_degrees() const;   // in [-90, 90]

  friend bool operator==(const Direction&, const Direction&) = default;

 private:
  explicit Direction(Vec3 unit) : v_(unit) {}
  Vec3 v_{0, 0, 1};
};

// Angle between two directions in [0, pi]. Exact to float64 rounding at both ends, where acos of the dot
// product loses half the digits (Kahan 2006, "How futile are mindless assessments of roundoff", section 12: 2
// atan2(|a-b|, |a+b|)).
double angle_radians(const Direction& a, const Direction& b);

// Parses "x,y,z" (normalised) or "longitude,latitude" in degrees. Throws BadInput naming the text.
Direction parse_direction(const std::string& text);

double radians_from_degrees(double degrees);
double degrees_from_radians(double radians);

}  // namespace lightstage::core
