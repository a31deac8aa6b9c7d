#include "model/methods.h"

#include <algorithm>

#include "core/error.h"
#include "core/sphere.h"
#include "core/text.h"
#include "model/alias_free_weights.h"
#include "model/checkpoint.h"
#include "model/classical.h"

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

const std::vector<Entry>& entries() {
  static const std::vector<Entry> all{
      {{"nearest", "the captured image of the nearest light; what every other method must beat",
        "Debevec et al. 2000, Acquiring the reflectance field of a human face"},
       [](const core::OlatScan& scan, const MethodOptions&) { return make_nearest(scan); }},
      {{"linear", "the nearest lights blended with weights that change continuously; fast and never negative",
        "Sun et al. 2020, Light Stage Super-Resolution, section 4.2"},
       [](const core::OlatScan& scan, const MethodOptions& options) {
         const double sharpness =
             options.sharpness.value_or(default_sharpness(core::median_spacing_radians(scan.directions())));
         return make_linear_blend(scan, options.neighbours, sharpness, options.domain);
       }},
      {{"barycentric",
        "the three lights around the query, weighted over the triangle between them; cheap, no knob to fit",
        "Renka 1997, Algorithm 772: STRIPACK, Delaunay triangulation and Voronoi diagram on the surface of a sphere"},
       [](const core::OlatScan& scan, const MethodOptions& options) { return make_barycentric(scan, options.domain); }},
      {{"rbf", "every pixel interpolated over the lights by thin-plate splines; the strongest without training",
        "Masselus et al. 2004, Smooth reconstruction and compact representation of reflectance functions for "
        "image-based relighting"},
       [](const core::OlatScan& scan, const MethodOptions& options) { return make_rbf(scan, options.domain); }},
      {{"blend",
        "a network that corrects rbf by choosing among captured pixels; sharp shadows, and no training is needed",
        "after Sun et al. 2020, Light Stage Super-Resolution"},
       make_network<Architecture::kBlend>},
      {{"superres", "the published network, trained by `lightstage train`; draws the picture anew",
        "Sun et al. 2020, Light Stage Super-Resolution"},
       make_network<Architecture::kSuperres>},
  };
  return all;
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

std::unique_ptr<LightInterpolator> make_interpolator(std::string_view method, const core::OlatScan& scan,
                                                     const MethodOptions& options) {
  const auto found =
      std::find_if(entries().begin(), entries().end(), [&](const Entry& entry) { return entry.info.name == method; });
  if (found != entries().end()) return found->make(scan, options);

  std::vector<std::string> names;
  for (const Entry& entry : entries()) names.push_back(entry.info.name);
  std::string message =
      "there is no method '" + std::string(method) + "'" + core::did_you_mean(method, names) + "; methods are:";
  for (const std::string& name : names) message += " " + name;
  throw core::UsageError(message);
}

}  // namespace lightstage::model
