// JSON that the store and checkpoints hold: the same text to every reader.
#include "capture/sequence.h"
#include "cli/jobs/provenance.h"
#include "db/store/verify_state.h"
#include "fuzz/target.h"
#include "model/checkpoint.h"
#include "sim/simulation.h"

namespace lightstage::model {
NetworkConfig config_from_json(const std::string& json);  // model/net/checkpoint_metadata.h, without torch
}

namespace lightstage::fuzz {

namespace {

const Registration kJson({"json", [](Bytes bytes) {
                            const std::string text(text_of(bytes));
                            tolerate([&] {
                              const sim::Simulation simulation = sim::simulation_from_json(text);
                              const std::string written = sim::to_json(simulation);
                              require(sim::to_json(sim::simulation_from_json(written)) == written,
                                      "a simulation that is written reads back");
                            });
                            db::Scan scan;
                            scan.name = "scan";
                            scan.provenance = text;
                            scan.steps.resize(5);
                            tolerate([&] { cli::capture_provenance(scan); });
                            tolerate([&] { cli::key_step(scan); });
                            tolerate([&] {
                              db::Step step;
                              step.kind = db::StepKind::kPattern;
                              step.pattern = text;
                              capture::levels(step, 20);
                            });
                            tolerate([&] { model::network_tensors(model::config_from_json(text)); });
                            write(scratch() / "verify.json", text);
                            db::read_verify_state(scratch());
                          }});

}  // namespace

}  // namespace lightstage::fuzz
