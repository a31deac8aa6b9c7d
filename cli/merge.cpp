#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "calib/response.h"
#include "cli/commands.h"
#include "cli/jobs/exposed_pictures.h"
#include "cli/options.h"
#include "cli/report/response_file.h"
#include "core/exposure_merge.h"
#include "core/progress.h"

namespace lightstage::cli {

namespace {

struct Options {
  ExposureFiles files;
  core::Encoding encoding = core::Encoding::kAuto;
  std::filesystem::path response;
  std::vector<std::filesystem::path> dark;
  std::optional<double> saturation;
  std::filesystem::path out;
};

// Values of a picture file to the light that fell in during the exposure.
core::Image developed(core::Image image, const std::optional<calib::CameraResponse>& response) {
  return response ? calib::exposure_of(image, *response) : std::move(image);
}

void divide(core::Image& image, double seconds) {
  for (float& v : image.values()) v = float(double(v) / seconds);
}

// Photographs are not overwritten by what is made of them, nor high dynamic range cut to what 8 bits hold.
void require_writable_result(const Options& options, const std::vector<std::filesystem::path>& inputs) {
  const std::string extension = lower_case_extension(options.out);
  if (extension != ".exr" && extension != ".hdr" && extension != ".tif" && extension != ".tiff") {
    throw core::UsageError("--out: '" + options.out.string() + "' would not hold it; write .exr, .hdr or .tiff");
  }
  for (const std::filesystem::path& input : inputs) {
    std::error_code not_there;
    if (std::filesystem::equivalent(options.out, input, not_there)) {
      throw core::UsageError("--out: '" + options.out.string() +
                             "' is one of the pictures that are merged; give it another name");
    }
  }
}

void run_merge(const Options& options, const Context& context) {
  if (!options.response.empty() && options.encoding != core::Encoding::kAuto) {
    throw core::UsageError("--response says what the pictures' numbers are; leave --encoding out");
  }
  std::optional<calib::CameraResponse> response;
  if (!options.response.empty()) response = read_response(options.response);
  const core::Encoding encoding = response ? core::Encoding::kLinear : options.encoding;
  ExposedPictures pictures = read_exposed_pictures(options.files, encoding);
  std::vector<std::filesystem::path> inputs = pictures.files;
  inputs.insert(inputs.end(), options.dark.begin(), options.dark.end());
  require_writable_result(options, inputs);
  const std::size_t count = pictures.images.size();
  if (options.dark.size() > 1 && options.dark.size() != count) {
    throw core::UsageError("--dark: give one dark picture for all, or one for each of the " + std::to_string(count) +
                           " pictures");
  }
  std::vector<core::Image> darks;
  for (std::size_t i = 0; i < count && !options.dark.empty(); ++i) {
    const std::filesystem::path& file = options.dark[options.dark.size() == 1 ? 0 : i];
    darks.push_back(developed(read_picture(file, encoding), response));
    if (darks.back().size() != pictures.images[i].size()) {
      throw core::BadInput(file.string() + ": the dark picture is of another size than " + pictures.files[i].string());
    }
    divide(darks.back(), pictures.seconds[i]);
  }
  std::vector<core::Exposure> exposures;
  for (std::size_t i = 0; i < count; ++i) {
    pictures.images[i] = developed(std::move(pictures.images[i]), response);
    divide(pictures.images[i], pictures.seconds[i]);
    const double clips = options.saturation.value_or(usual_saturation(pictures.files[i]));
    exposures.push_back({pictures.images[i], pictures.seconds[i], clips / pictures.seconds[i],
                         darks.empty() ? core::ImageView() : darks[i].view()});
  }
  const core::MergedExposures merged = core::merge_exposures(exposures);
  const auto values = merged.image.values();
  if (!darks.empty() &&
      std::count_if(values.begin(), values.end(), [](float v) { return v < 0; }) > std::ptrdiff_t(values.size() / 2)) {
    core::warn("--dark is brighter than most of the pictures: was it taken without light, with the same exposures?");
  }
  core::write_image(options.out, merged.image);
  std::size_t pixels = 0;
  for (const float v : merged.saturated.values()) pixels += v > 0;
  std::string text = "merged " + std::to_string(count) + " exposures to " + options.out.string() + "\n";
  if (pixels > 0) {
    text += std::to_string(pixels) + " pixels saturate in every exposure: they are at least as bright as shown\n";
  }
  context.result(text, {{"file", options.out.string()},
                        {"exposures", count},
                        {"saturated_pixels", pixels},
                        {"saturated_values", merged.saturated_values}});
}

}  // namespace

void add_merge(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("merge", "Several exposures of one scene as one picture (HDR)");
  command->footer(
      "Values of the result are per second of exposure. Scans captured with several exposures are merged by "
      "themselves.\n"
      "Example:\n  lightstage merge a.tiff b.tiff c.tiff --exposures 1/200,1/50,0.08 --encoding linear --out hdr.exr");
  auto options = std::make_shared<Options>();
  add_exposure_options(*command, options->files);
  add_encoding_option(*command, options->encoding, "float files linear, others srgb");
  command->add_option("--response", options->response, "response.csv of `calibrate response`, instead of an encoding");
  command->add_option("--dark", options->dark, "A picture without light for all exposures, or one for each");
  command
      ->add_option("--saturation", options->saturation,
                   "Value at which the camera clips, linear; 0: not known [1; of EXR and HDR files 0]")
      ->check(number_between(0.0, 1e9));
  command->add_option("--out", options->out, "Picture file to write: EXR, HDR or TIFF")->required();
  command->callback([options, &context] { run_merge(*options, context); });
}

}  // namespace lightstage::cli
