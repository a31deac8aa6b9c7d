// TOML files: stages with their hardware, sequences, rigs of light, and colour matrices.
#include "capture/sequence.h"
#include "capture/stage.h"
#include "cli/report/colour_file.h"
#include "fuzz/target.h"
#include "relight/light_rig.h"

namespace lightstage::fuzz {

namespace {

const Registration kStage({"stage", [](Bytes bytes) {
                             const capture::Stage stage = capture::parse_stage(text_of(bytes), "stage.toml");
                             const std::string text = capture::to_toml(stage);
                             require(capture::to_toml(capture::parse_stage(text, "written")) == text,
                                     "a stage that is written reads back");
                             capture::stage_key(stage);
                           }});

const Registration kSequence({"sequence", [](Bytes bytes) {
                                constexpr std::size_t kLights = 20;
                                const auto sequence = capture::parse_sequence(text_of(bytes), "sequence.toml", kLights);
                                for (const db::Step& step : sequence.steps) capture::levels(step, kLights);
                                if (sequence.steps.size() > 10'000) return;
                                const std::string text = capture::to_toml(sequence);
                                require(capture::to_toml(capture::parse_sequence(text, "written", kLights)) == text,
                                        "a sequence that is written reads back");
                              }});

const Registration kRig({"rig", [](Bytes bytes) {
                           const auto rig = relight::LightRig::parse(text_of(bytes), "rig.toml", scratch());
                           for (const int frame : {0, rig.frames / 2, rig.frames - 1}) rig.frame(frame);
                         }});

const Registration kColour({"colour", [](Bytes bytes) {
                              const auto fit = cli::read_colour(write(scratch() / "colour.toml", bytes));
                              cli::whole_matrix(fit, false);
                            }});

}  // namespace

}  // namespace lightstage::fuzz
