#include "model/net/training_settings.h"

#include <cmath>
#include <string>

#include "core/error.h"
#include "model/net/checkpoint_metadata.h"

namespace lightstage::model {
namespace {

using Json = nlohmann::json;

bool superres(const TrainOptions& options) {
  return options.config.architecture == Architecture::kSuperres;
}

// Whether it is made from an active set, which xu and meka are not.
bool pools(const TrainOptions& options) {
  return has_sharpness(options.config.architecture);
}

std::string name_of(ActiveSetChoice choice) {
  if (choice == ActiveSetChoice::kRandom) return "random";
  return choice == ActiveSetChoice::kNaive ? "naive" : "thinned";
}

// A model's name and its own provenance, so that a chain of them tells of all data that went into the last.
Json origin(const std::filesystem::path& checkpoint) {
  const std::string provenance = read_checkpoint_info(checkpoint).provenance;
  const Json parsed = Json::parse(provenance, nullptr, /*allow_exceptions=*/false);
  return {{"file", checkpoint.filename().string()}, {"provenance", parsed.is_discarded() ? Json(provenance) : parsed}};
}

}  // namespace

bool trains_progressively(const TrainOptions& options) {
  return options.progressive.value_or(superres(options) && !options.start_from);
}

double learning_rate(const TrainOptions& options) {
  // What a model has learned is not to be lost to the first steps on other data.
  const double adapting = options.start_from ? 0.1 : 1;
  const bool blend = options.config.architecture == Architecture::kBlend;
  return options.learning_rate.value_or(adapting * (blend ? 2e-3 : 1e-3));
}

ActiveSetChoice active_set_choice(const TrainOptions& options) {
  if (superres(options)) return options.active_set.value_or(ActiveSetChoice::kRandom);
  return options.active_set.value_or(pools(options) ? ActiveSetChoice::kThinned : ActiveSetChoice::kNaive);
}

void check(const TrainOptions& options) {
  const auto require = [](bool holds, const std::string& problem) {
    if (!holds) throw core::UsageError("training: " + problem);
  };
  require(options.minutes || options.steps, "give the minutes or the steps that it may take");
  require(!options.minutes || (std::isfinite(*options.minutes) && *options.minutes > 0),
          "minutes must be a number > 0");
  require(!options.steps || *options.steps > 0, "steps must be > 0");
  require(options.crop > 0, "the crop must be > 0 pixels");
  require(options.candidates >= options.config.neighbours,
          "candidates must be at least the network's " + std::to_string(options.config.neighbours) + " neighbours");
  require(std::isfinite(learning_rate(options)) && learning_rate(options) > 0,
          "the learning rate must be a number > 0");
  require(std::isfinite(options.sharpness_rate) && options.sharpness_rate >= 0,
          "the sharpness rate must be a number >= 0");
  require(options.validate_every > 0, "the steps between validations must be > 0");
  require(options.early_stop >= 0, "the validations before an early stop must be >= 0");
  const std::string name(architecture_name(options.config.architecture));
  require(superres(options) || !trains_progressively(options),
          name + " is not trained progressively: it has no coarse pictures");
  require(pools(options) || active_set_choice(options) == ActiveSetChoice::kNaive,
          name + " looks at the same pictures for every query: there is no active set to choose");
}

Json training_settings(const Json& data, const TrainOptions& options) {
  return {{"data", data},
          {"config", Json::parse(config_to_json(options.config))},
          {"seed", options.seed},
          {"crop", options.crop},
          {"candidates", options.candidates},
          {"active_set", name_of(active_set_choice(options))},
          {"progressive", trains_progressively(options)},
          {"learning_rate", learning_rate(options)},
          {"sharpness_rate", options.sharpness_rate},
          {"validate_every", options.validate_every},
          {"held_out_every", options.held_out_every},
          {"start_from", options.start_from ? origin(*options.start_from) : Json()}};
}

Json description(std::span<const core::OlatScan> scans) {
  Json names = Json::array();
  for (const core::OlatScan& scan : scans) {
    names.push_back({{"name", scan.name()},
                     {"lights", scan.light_count()},
                     {"height", scan.image_size().height},
                     {"width", scan.image_size().width},
                     {"exposure", scan.exposure()}});
  }
  return names;
}

}  // namespace lightstage::model
