#include "model/methods.h"

#include "core/error.h"
#include "core/sphere.h"
#include "core/text.h"
#include "model/alias_free_weights.h"
#include "model/checkpoint.h"
#include "model/classical.h"
#include "model/classical/fuchs.h"
#include "model/classical/photometric_stereo.h"
#include "model/knobs.h"

namespace lightstage::model {

namespace {

// A method, and how to make it.
struct Entry {
  MethodInfo info;
  std::unique_ptr<LightInterpolator> (*make)(const core::OlatScan& scan, const MethodOptions& options);
};

template <Architecture architecture>
std::unique_ptr<LightInterpolator> make_network(const core::OlatScan& scan, const MethodOptions& options) {
  const std::string name(architecture_name(architecture));
  if (options.model_file.empty()) throw core::UsageError(name + " needs a model file");
  const Architecture found = read_checkpoint_info(options.model_file).config.architecture;
  if (found != architecture) {
    throw core::UsageError(options.model_file.string() + ": is a model for --method " +
                           std::string(architecture_name(found)) + ", not " + name);
  }
  return make_network_interpolator(scan, options.model_file, options.network);
}

Knob domain_knob() {
  return choice_knob<Domain>(
      "--domain",
      "the values that are summed, linear light or display-encoded; an environment is always summed linearly",
      [](MethodOptions& options) -> Domain& { return options.domain; }, {"linear", "display"});
}

Knob model_knob(const std::string& otherwise) {
  return {"--model", "the network's weights", "the newest trained on the scan" + otherwise, "a file or name", false,
          {}};
}

// To add a method: one entry here.
const std::vector<Entry>& entries() {
  static const std::vector<Entry> all{
      {.info = {.name = "nearest",
                .summary = "the captured image of the nearest light; what every other method must beat",
                .citation = "Debevec et al. 2000, Acquiring the reflectance field of a human face",
                .knobs = {}},
       .make = [](const core::OlatScan& scan, const MethodOptions&) { return make_nearest(scan); }},

      {.info = {.name = "linear",
                .summary = "the nearest lights blended with weights that change continuously; fast and never negative",
                .citation = "Sun et al. 2020, Light Stage Super-Resolution, section 4.2",
                .knobs = {whole_number_knob(
                              "--neighbours", "lights that are blended",
                              [](MethodOptions& options) -> int& { return options.neighbours; }, 1, 1000),
                          number_knob(
                              "--sharpness", "s of the weights",
                              [](MethodOptions& options) -> std::optional<double>& { return options.sharpness; },
                              "from the light spacing", 0, 1e6),
                          domain_knob()}},
       .make =
           [](const core::OlatScan& scan, const MethodOptions& options) {
             const double sharpness =
                 options.sharpness.value_or(default_sharpness(core::median_spacing_radians(scan.directions())));
             return make_linear_blend(scan, options.neighbours, sharpness, options.domain);
           }},

      {.info = {.name = "barycentric",
                .summary =
                    "the three lights around the query, weighted over the triangle between them; cheap, nothing to fit",
                .citation = "Renka 1997, Algorithm 772: STRIPACK, Delaunay triangulation and Voronoi diagram on the "
                            "surface of a sphere",
                .knobs = {domain_knob()}},
       .make = [](const core::OlatScan& scan,
                  const MethodOptions& options) { return make_barycentric(scan, options.domain); }},

      {.info =
           {.name = "rbf",
            .summary =
                "every pixel interpolated over the lights by radial basis functions; the strongest without training",
            .citation = "Masselus et al. 2004, Smooth reconstruction and compact representation of reflectance "
                        "functions for image-based relighting",
            .knobs = {choice_knob<RadialKernel>(
                          "--kernel", "the function of the distance, smoother or ringing less",
                          [](MethodOptions& options) -> RadialKernel& { return options.rbf.kernel; },
                          {"thin_plate", "linear"}),
                      number_knob(
                          "--smoothing",
                          "how far noise, and detail with it, is averaged out over the lights; 0 is exact at the "
                          "captured lights, 1e-3 much",
                          [](MethodOptions& options) -> double& { return options.rbf.smoothing; }, 0, 1e6),
                      domain_knob()}},
       .make = [](const core::OlatScan& scan,
                  const MethodOptions& options) { return make_rbf(scan, options.domain, options.rbf); }},

      {.info = {.name = "bspline",
                .summary = "every pixel interpolated over the lights by multilevel B-splines, coarse to fine; smooth, "
                           "never rings far",
                .citation = "Masselus et al. 2004, Smooth reconstruction and compact representation of reflectance "
                            "functions for image-based relighting",
                .knobs = {domain_knob()}},
       .make = [](const core::OlatScan& scan,
                  const MethodOptions& options) { return make_bspline(scan, options.domain); }},

      {.info = {.name = "fuchs",
                .summary =
                    "layers: highlights moved by optical flow, shadow edges by their distance, the rest blended; "
                    "sharp, and no training is needed",
                .citation = "Fuchs et al. 2007, Superresolution reflectance fields: synthesizing images for "
                            "intermediate light directions",
                .knobs = {}},
       .make = [](const core::OlatScan& scan, const MethodOptions&) { return make_fuchs(scan); }},

      {.info = {.name = "photometric_stereo",
                .summary = "a matte surface fitted to every pixel, with the shadows and highlights of fuchs; its maps: "
                           "`lightstage normals`",
                .citation = "Woodham 1980, Photometric method for determining surface orientation from multiple images",
                .knobs = {}},
       .make = [](const core::OlatScan& scan, const MethodOptions&) { return make_photometric_stereo(scan); }},

      {.info = {.name = "blend",
                .summary = "a network that corrects rbf by choosing among captured pixels; sharp shadows, and no "
                           "training is needed",
                .citation = "after Sun et al. 2020, Light Stage Super-Resolution",
                .knobs = {model_knob(", else the one that comes with the program")}},
       .make = make_network<Architecture::kBlend>},

      {.info =
           {.name = "superres",
            .summary = "the published network, trained by `lightstage train`; draws the picture anew",
            .citation = "Sun et al. 2020, Light Stage Super-Resolution",
            .knobs =
                {model_knob(""),
                 flag_knob("--bf16", "multiply bfloat16 numbers; 1.7 times as fast, values within about 0.01",
                           [](MethodOptions& options) -> bool& { return options.network.bfloat16; }),
                 flag_knob("--half-cache",
                           "keep what the network makes of captured images in 16 bits, so that twice as much fits",
                           [](MethodOptions& options) -> bool& { return options.network.half_storage; }),
                 megabytes_knob("--cache-mb", "memory for captured images and what the network makes of each, MiB",
                                [](MethodOptions& options) -> std::size_t& { return options.network.cache_bytes; }),
                 megabytes_knob("--spill-mb", "temporary file for encoded images that do not fit there, MiB",
                                [](MethodOptions& options) -> std::size_t& { return options.network.spill_bytes; })}},
       .make = make_network<Architecture::kSuperres>},

      {.info = {.name = "xu",
                .summary = "a network that draws the picture from the same 8 lights for every query, which training "
                           "chose; for capturing with few lights",
                .citation = "Xu et al. 2018, Deep image-based relighting from optimal sparse samples",
                .knobs = {model_knob("")}},
       .make = make_network<Architecture::kXu>},

      {.info = {.name = "xu_adaptive",
                .summary = "the same network given the lights nearest to the query, pooled so that it does not jump; a "
                           "baseline for superres",
                .citation = "Xu et al. 2018, Deep image-based relighting from optimal sparse samples",
                .knobs = {model_knob("")}},
       .make = make_network<Architecture::kXuAdaptive>},

      {.info = {.name = "meka",
                .summary =
                    "a network that draws the picture from two colour gradients, summed of all lights; a baseline",
                .citation = "Meka et al. 2019, Deep reflectance fields",
                .knobs = {model_knob("")}},
       .make = make_network<Architecture::kMeka>},
  };
  return all;
}

const Entry& entry_named(std::string_view name) {
  for (const Entry& entry : entries())
    if (entry.info.name == name) return entry;
  std::vector<std::string> names;
  for (const Entry& entry : entries()) names.push_back(entry.info.name);
  throw core::UsageError("no method '" + std::string(name) + "'" + core::did_you_mean(name, names) + "; methods are " +
                         core::joined(names, ", "));
}

}  // namespace

const std::vector<MethodInfo>& methods() {
  static const std::vector<MethodInfo> infos = [] {
    std::vector<MethodInfo> result;
    for (const Entry& entry : entries()) result.push_back(entry.info);
    return result;
  }();
  return infos;
}

const MethodInfo& method_info(std::string_view name) {
  return entry_named(name).info;
}

std::unique_ptr<LightInterpolator> make_interpolator(std::string_view method, const core::OlatScan& scan,
                                                     const MethodOptions& options) {
  return entry_named(method).make(scan, options);
}

}  // namespace lightstage::model
