#include "cli/jobs/exposed_pictures.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <numeric>

#include "cli/options.h"
#include "core/file.h"
#include "core/foreign_path.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

// Seconds: "0.02" or "1/50".
std::optional<double> seconds_of(std::string_view text) {
  const std::vector<std::string_view> parts = core::split(text, '/');
  if (parts.size() > 2) return std::nullopt;
  std::optional<double> value = core::parse_number(core::trim(parts.front()));
  if (value && parts.size() == 2) {
    const std::optional<double> divisor = core::parse_number(core::trim(parts.back()));
    value = divisor ? std::optional(*value / *divisor) : std::nullopt;
  }
  return value && *value > 0 && std::isfinite(*value) ? value : std::nullopt;
}

double mean(const core::Image& image) {
  double sum = 0;
  for (const float v : image.values()) sum += double(v);
  return sum / double(std::max<std::size_t>(1, image.values().size()));
}

// Noise and flicker are below the tenth; times in another order than the pictures are far above it.
void require_brighter_with_time(const ExposedPictures& pictures) {
  constexpr double kFlicker = 0.1;
  std::vector<std::size_t> order(pictures.images.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return pictures.seconds[a] < pictures.seconds[b]; });
  std::vector<double> means;
  for (const core::Image& image : pictures.images) means.push_back(mean(image));
  const double noise = 1e-3 * *std::max_element(means.begin(), means.end());  // of pictures that are all but black
  double brightest = -std::numeric_limits<double>::infinity();
  std::size_t brightest_of = order.front();
  for (const std::size_t i : order) {
    const double found = means[i];
    if (found < brightest - std::max(kFlicker * std::abs(brightest), noise) &&
        pictures.seconds[i] > pictures.seconds[brightest_of]) {
      throw core::BadInput(pictures.files[i].string() + ": is darker than " + pictures.files[brightest_of].string() +
                           ", of a shorter exposure; give the times in the order of the pictures");
    }
    if (found > brightest) {
      brightest = found;
      brightest_of = i;
    }
  }
}

void read_csv(const std::filesystem::path& path, ExposedPictures& pictures) {
  const std::string text = core::read_text_file(path);
  int line_number = 0;
  for (const std::string_view raw : core::split(text, '\n')) {
    ++line_number;
    const std::string_view line = core::trim(raw);
    if (line.empty()) continue;
    const std::string place = path.string() + ":" + std::to_string(line_number);
    const std::vector<std::string_view> fields = core::split(line, ',');
    if (fields.size() != 2) throw core::BadInput(place + ": a line must be `file,seconds`");
    const std::optional<double> seconds = seconds_of(fields[1]);
    if (!seconds && line_number == 1) continue;  // the names of the columns
    if (!seconds) throw core::BadInput(place + ": '" + std::string(fields[1]) + "' is no exposure time in seconds");
    pictures.files.push_back(core::path_inside(path.parent_path(), core::trim(fields[0]), place));
    pictures.seconds.push_back(*seconds);
  }
  if (pictures.files.empty()) throw core::BadInput(path.string() + ": names no picture; a line must be `file,seconds`");
}

}  // namespace

void add_exposure_options(CLI::App& command, ExposureFiles& files) {
  command.add_option("PICTURE", files.pictures, "Pictures of one scene, differently exposed");
  command.add_option("--exposures", files.times,
                     "Exposure times in seconds, in the order of the pictures: 1/200,1/50,0.08");
  command.add_option("--csv", files.csv, "Instead of both: a file of lines `file,seconds`, files relative to it");
}

void add_encoding_option(CLI::App& command, core::Encoding& encoding, const std::string& usual) {
  static const std::map<std::string, core::Encoding> kNames{{"linear", core::Encoding::kLinear},
                                                            {"srgb", core::Encoding::kSrgb}};
  command.add_option("--encoding", encoding, "linear or srgb: what the files' numbers are [" + usual + "]")
      ->transform(one_of(kNames));
}

ExposedPictures read_exposed_pictures(const ExposureFiles& files, core::Encoding encoding) {
  ExposedPictures pictures;
  if (!files.csv.empty()) {
    if (!files.pictures.empty() || !files.times.empty()) {
      throw core::UsageError("--csv names pictures and exposure times; leave the others out");
    }
    read_csv(files.csv, pictures);
  } else {
    pictures.files = files.pictures;
    if (!files.times.empty()) {
      for (const std::string_view text : core::split(files.times, ',')) {
        const std::optional<double> seconds = seconds_of(text);
        if (!seconds) {
          throw core::UsageError("--exposures: '" + std::string(text) + "' is no time in seconds (0.02 or 1/50)");
        }
        pictures.seconds.push_back(*seconds);
      }
    }
    if (pictures.files.size() != pictures.seconds.size()) {
      throw core::UsageError("--exposures gives " + std::to_string(pictures.seconds.size()) + " times for " +
                             std::to_string(pictures.files.size()) + " pictures; one for each is needed");
    }
  }
  if (pictures.files.empty()) {
    throw core::UsageError("no pictures: name them with their --exposures, or give --csv FILE");
  }
  for (const std::filesystem::path& file : pictures.files) {
    pictures.images.push_back(read_picture(file, encoding));
    if (pictures.images.back().size() != pictures.images.front().size()) {
      throw core::BadInput(file.string() + ": the picture is of another size than " + pictures.files.front().string());
    }
  }
  require_brighter_with_time(pictures);
  return pictures;
}

core::Image read_picture(const std::filesystem::path& file, core::Encoding encoding) {
  core::Image image = core::read_image(file, {.encoding = encoding});
  return image.channels() == 1 || image.channels() == 3 ? std::move(image) : core::to_rgb(image);
}

std::string lower_case_extension(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

double usual_saturation(const std::filesystem::path& file) {
  const std::string extension = lower_case_extension(file);
  return extension == ".exr" || extension == ".hdr" ? 0 : 1;
}

}  // namespace lightstage::cli
