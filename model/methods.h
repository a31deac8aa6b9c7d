// Methods by name.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "model/interpolator.h"
#include "model/network_interpolator.h"

namespace lightstage::model {

// The values in which images are summed: linear light (as physics does) or display-encoded ones (closer to what eyes and the
// published metrics judge, since an error in the dark counts for more).
enum class Domain { kLinear, kDisplay };

// The function of the distance that rbf sums: r^2 log r, the smoother, or r itself, which rings less.
enum class RadialKernel { kThinPlate, kLinear };

struct RadialBasis {
  RadialKernel kernel = RadialKernel::kThinPlate;
  double smoothing = 0;  // 0: exact at the captured lights; model/classical/radial_basis.h gives the unit
};

struct MethodOptions;

// What a user may choose of a method; command lines and listings are made from it.
struct Knob {
  std::string option;         // "--sharpness"; the same option means the same in every method that has it
  std::string what;           // "s of the weights"
  std::string default_value;  // "8"; or where it comes from: "from the light spacing"
  std::string values;         // "1..1000", "linear|display", "on|off", "a file or name"
  bool flag = false;          // given without a value, which turns it on
  // Puts the value that a text says into the options. Throws UsageError naming the option for a text that says none. Empty for --model, a
  // name that the program first has to find a file for.
  std::function<void(MethodOptions& options, const std::string& text)> set;
};

struct MethodInfo {
  std::string name;
  std::string summary;   // one line: what it does and what it is for
  std::string citation;  // "Sun et al. 2020, Light Stage Super-Resolution"
  std::vector<Knob> knobs;
};

// nearest, linear, barycentric, rbf, bspline, fuchs, photometric_stereo, blend, superres, xu, xu_adaptive, meka; in this order.
const std::vector<MethodInfo>& methods();

// Throws UsageError for a name that does not exist (with the nearest one, and all).
const MethodInfo& method_info(std::string_view name);

struct MethodOptions {
  Domain domain = Domain::
      kDisplay;  // of linear, barycentric, rbf and bspline; nearest is the same in both, networks work display-encoded
  int neighbours = 8;               // k of linear; networks take theirs from the checkpoint
  std::optional<double> sharpness;  // s of linear; default_sharpness of the scan's spacing otherwise
  RadialBasis rbf;
  NetworkOptions network;            // of superres
  std::filesystem::path model_file;  // checkpoint for methods that are networks
};

// Throws UsageError as method_info and for a network without model file or with another network's, BadInput for a checkpoint that cannot be used.
std::unique_ptr<LightInterpolator> make_interpolator(std::string_view method, const core::OlatScan& scan,
                                                     const MethodOptions& options = {});

}  // namespace lightstage::model
