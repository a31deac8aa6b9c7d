#include "sim/simulation.h"

#include <nlohmann/json.hpp>
#include <set>

#include "core/error.h"

namespace lightstage::sim {
namespace {

using nlohmann::json;

struct KindName {
  SubjectKind kind;
  const char* name;
};
constexpr std::array<KindName, 6> kKindNames{{{SubjectKind::kProceduralHead, "procedural_head"},
                                              {SubjectKind::kMesh, "mesh"},
                                              {SubjectKind::kMirrorBall, "mirror_ball"},
                                              {SubjectKind::kGreyBall, "grey_ball"},
                                              {SubjectKind::kChessboard, "chessboard"},
                                              {SubjectKind::kWhiteCard, "white_card"}}};

// One description of every field serves writing and reading: `field(name, value)` is called for each.
template <class Spec, class Field>
void describe_subject(Spec& s, Field&& field) {
  field("seed", s.seed);
  field("mesh_path", s.mesh_path);
  field("mesh_hash", s.mesh_hash);
  field("size_m", s.size_m);
  field("albedo", s.albedo);
  field("yaw_degrees", s.yaw_degrees);
}

template <class Spec, class Field>
void describe_motion(Spec& s, Field&& field) {
  field("amplitude_m", s.amplitude_m);
  field("rotation_degrees", s.rotation_degrees);
}

template <class Spec, class Field>
void describe_sensor(Spec& s, Field&& field) {
  field("noise", s.noise);
  field("full_well_electrons", s.full_well_electrons);
  field("read_noise_electrons", s.read_noise_electrons);
  field("bits", s.bits);
  field("vignetting", s.vignetting);
  field("bayer", s.bayer);
}

template <class Spec, class Field>
void describe_faults(Spec& s, Field&& field) {
  field("drop_exposures", s.drop_exposures);
  field("duplicate_exposures", s.duplicate_exposures);
  field("damage_exposures", s.damage_exposures);
  field("light_timeouts", s.light_timeouts);
  field("drop_probability", s.drop_probability);
  field("rise_time_ns", s.rise_time);
  field("trigger_jitter_ns", s.trigger_jitter);
}

template <class Spec, class Field>
void describe_rendering(Spec& s, Field&& field) {
  field("indirect_bounce", s.indirect_bounce);
  field("pixel_samples", s.pixel_samples);
  field("seed", s.seed);
}

// A JSON object whose every key must be asked for exactly once.
class ObjectReader {
 public:
  ObjectReader(const json& object, std::string path) : object_(object), path_(std::move(path)) {
    if (!object.is_object()) throw core::BadInput(path_ + ": must be a JSON object");
  }

  const json& at(const char* key) {
    const auto found = object_.find(key);
    if (found == object_.end()) throw core::BadInput(path_ + ": key '" + key + "' is missing");
    known_.insert(key);
    return *found;
  }

  bool has(const char* key) const { return object_.contains(key); }

  template <class T>
  void operator()(const char* key, T& value) {
    value = read<T>(at(key), key);
  }

  void finish() const {
    for (const auto& [key, value] : object_.items()) {
      if (known_.count(key) == 0) {
        throw core::BadInput(path_ + ": key '" + key + "' is not known; a newer version may have written it");
      }
    }
  }

  [[noreturn]] void fail(const char* key, const std::string& problem) const {
    throw core::BadInput(path_ + ": key '" + key + "' " + problem);
  }

 private:
  template <class T>
  T read(const json& value, const char* key) const {
    if constexpr (std::is_same_v<T, bool>) {
      if (!value.is_boolean()) fail(key, "must be true or false");
      return value.get<bool>();
    } else if constexpr (std::is_floating_point_v<T>) {
      if (!value.is_number()) fail(key, "must be a number");
      return value.get<T>();
    } else if constexpr (std::is_integral_v<T>) {
      if (!value.is_number_integer()) fail(key, "must be a whole number");
      const bool negative = !value.is_number_unsigned();
      const bool fits =
          negative ? std::in_range<T>(value.get<std::int64_t>()) : std::in_range<T>(value.get<std::uint64_t>());
      if (!fits) fail(key, "is out of range");
      return value.get<T>();
    } else if constexpr (std::is_same_v<T, std::string>) {
      if (!value.is_string()) fail(key, "must be a string");
      return value.get<std::string>();
    } else {
      if (!value.is_array()) fail(key, "must be an array");
      T result;
      for (const json& item : value) result.push_back(read<typename T::value_type>(item, key));
      return result;
    }
  }

  const json& object_;
  std::string path_;
  std::set<std::string> known_;
};

}  // namespace

std::string to_json(const Simulation& simulation) {
  nlohmann::ordered_json root;
  const auto into = [](nlohmann::ordered_json& object) {
    return [&object](const char* key, const auto& value) { object[key] = value; };
  };
  // A stage has its own text form, which keeps every bit.
  root["stage_toml"] = capture::to_toml(simulation.stage);
  const auto name = std::find_if(kKindNames.begin(), kKindNames.end(),
                                 [&](const KindName& k) { return k.kind == simulation.subject.kind; });
  root["subject"]["kind"] = name->name;
  describe_subject(simulation.subject, into(root["subject"]));
  const core::Vec3 place = simulation.subject.position;
  if (norm(place) > 0) root["subject"]["position_m"] = {place.x, place.y, place.z};
  describe_motion(simulation.motion, into(root["motion"]));
  describe_sensor(simulation.sensor, into(root["sensor"]));
  describe_faults(simulation.faults, into(root["faults"]));
  describe_rendering(simulation, into(root));
  return root.dump(2);
}

Simulation simulation_from_json(std::string_view text) {
  const json document = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (document.is_discarded()) throw core::BadInput("simulation: not valid JSON");
  Simulation result;
  ObjectReader root(document, "simulation");
  std::string stage_toml;
  root("stage_toml", stage_toml);
  result.stage = capture::parse_stage(stage_toml, "simulation: stage_toml");
  describe_rendering(result, root);

  ObjectReader subject(root.at("subject"), "simulation: subject");
  std::string kind_name;
  subject("kind", kind_name);
  const auto kind =
      std::find_if(kKindNames.begin(), kKindNames.end(), [&](const KindName& k) { return k.name == kind_name; });
  if (kind == kKindNames.end()) subject.fail("kind", "is '" + kind_name + "', which is not a kind of subject");
  result.subject.kind = kind->kind;
  describe_subject(result.subject, subject);
  if (subject.has("position_m")) {  // not written for a subject at stage centre
    std::vector<double> place;
    subject("position_m", place);
    if (place.size() != 3) subject.fail("position_m", "must be three numbers");
    result.subject.position = {place[0], place[1], place[2]};
  }

  ObjectReader motion(root.at("motion"), "simulation: motion");
  describe_motion(result.motion, motion);
  ObjectReader sensor(root.at("sensor"), "simulation: sensor");
  describe_sensor(result.sensor, sensor);
  ObjectReader faults(root.at("faults"), "simulation: faults");
  describe_faults(result.faults, faults);
  for (const ObjectReader* object : {&root, &subject, &motion, &sensor, &faults}) object->finish();
  return result;
}

double subject_size_m(const SubjectSpec& subject) {
  if (subject.size_m != 0) return subject.size_m;
  switch (subject.kind) {
    case SubjectKind::kMirrorBall:
    case SubjectKind::kGreyBall:
      return 0.06;
    case SubjectKind::kChessboard:
      return 0.16;
    case SubjectKind::kWhiteCard:
      return 0.8;
    case SubjectKind::kProceduralHead:
    case SubjectKind::kMesh:
      break;
  }
  return 0.25;
}

}  // namespace lightstage::sim
