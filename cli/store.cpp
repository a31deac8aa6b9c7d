#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/scans.h"
#include "cli/store_keeping.h"
#include "core/error.h"
#include "core/text.h"
#include "db/scan_lock.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

void list(Context& context) {
  const db::Store store = context.open_store();
  ordered_json array = ordered_json::array();
  std::vector<std::vector<std::string>> rows{{"scan", "kind", "steps", "frames", "cameras", "made"}};
  for (const db::ScanSummary& scan : store.scan_summaries()) {
    const std::string kind(db::to_string(scan.kind));
    const std::size_t whole = scan.steps * scan.cameras.size();
    rows.push_back({scan.name, kind, std::to_string(scan.steps),
                    std::to_string(scan.frames) + (scan.frames < whole ? " of " + std::to_string(whole) : ""),
                    std::to_string(scan.cameras.size()), scan.created_utc});
    array.push_back({{"name", scan.name},
                     {"kind", kind},
                     {"steps", scan.steps},
                     {"frames", scan.frames},
                     {"missing", whole - std::min(whole, scan.frames)},
                     {"cameras", scan.cameras},
                     {"created", scan.created_utc}});
  }
  context.result(rows.size() > 1 ? table(rows) : "the store holds no scans\n", {{"scans", array}});
}

void show(const std::string& name, Context& context) {
  const db::Store store = context.open_store();
  const db::Scan scan = store.scan(name);
  ordered_json object{{"name", scan.name},           {"kind", db::to_string(scan.kind)},
                      {"created", scan.created_utc}, {"program_version", scan.program_version},
                      {"stage", scan.stage_key},     {"cameras", scan.cameras},
                      {"steps", scan.steps.size()},  {"frames", store.frames(scan.id).size()}};
  std::string text = scan.name + ": " + std::string(db::to_string(scan.kind)) + ", made " + scan.created_utc +
                     " by version " + scan.program_version + "\n  " + core::counted(scan.steps.size(), "step") + ", " +
                     core::counted(store.frames(scan.id).size(), "frame") + "\n";
  ordered_json products = ordered_json::array();
  for (const char* kind : {"mask", "alignment", "weights", "picture", "normals", "virtual_stage"}) {
    for (const db::Product& product : store.products(kind)) {
      const bool about = product.scan_id == scan.id || std::find(product.input_scans.begin(), product.input_scans.end(),
                                                                 scan.id) != product.input_scans.end();
      if (!about) continue;
      text += "  " + product.kind + (product.name.empty() ? "" : " '" + product.name + "'") + ", made " +
              product.created_utc + " " + product.parameters + "\n";
      products.push_back({{"kind", product.kind},
                          {"name", product.name},
                          {"created", product.created_utc},
                          {"parameters", ordered_json::parse(product.parameters, nullptr, false)}});
    }
  }
  if (const auto calibration = store.newest_calibration(scan.stage_key)) {
    const auto lights = store.calibrated_lights(calibration->id);
    std::size_t placed = 0;
    for (const db::CalibratedLight& light : lights) placed += light.placed ? 1 : 0;
    text += "  calibration, made " + calibration->created_utc + ": " + std::to_string(placed) + " of " +
            std::to_string(lights.size()) + " lights placed\n";
    object["calibration"] = {{"created", calibration->created_utc}, {"lights", lights.size()}, {"placed", placed}};
  }
  object["products"] = products;
  object["provenance"] = ordered_json::parse(scan.provenance, nullptr, false);
  context.result(text, object);
}

}  // namespace

void add_store(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("store", "Look into the store, check it, mend it, and keep copies of it");
  command->require_subcommand(1);
  command->footer(
      "Examples:\n  lightstage store ls\n  lightstage store show head\n  lightstage store verify\n  lightstage store "
      "backup /mnt/disk/head-store");
  CLI::App* ls = command->add_subcommand("ls", "List the scans");
  ls->fallthrough();
  ls->callback([&context] { list(context); });

  CLI::App* one = command->add_subcommand("show", "One scan, with what was derived from it");
  one->fallthrough();
  auto name = std::make_shared<std::string>();
  one->add_option("SCAN", *name, "The scan")->required();
  one->callback([name, &context] { show(*name, context); });

  CLI::App* remove = command->add_subcommand("rm",
                                             "Remove a scan with its masks and alignments and the entries of pictures "
                                             "and models made from it; their files stay");
  remove->fallthrough();
  auto doomed = std::make_shared<std::string>();
  auto certain = std::make_shared<bool>(false);
  remove->add_option("SCAN", *doomed, "The scan")->required();
  remove->add_flag("--yes", *certain, "Really: a capture cannot be repeated");
  add_store_keeping(*command, context);
  remove->callback([doomed, certain, &context] {
    db::Store store = context.open_store();
    const db::Scan scan = store.scan(*doomed);
    if (!*certain) throw core::UsageError("removing '" + scan.name + "' cannot be undone: add --yes");
    const db::ScanLock alone(store.folder(), scan.name, "is being removed");
    std::string text = "removed '" + scan.name + "'\n";
    ordered_json left = ordered_json::array();
    for (const db::Product& weights : store.remove_scan(scan.id)) {
      left.push_back(weights_file(weights).string());
      text += "no longer listed: the model trained on it, " + left.back().get<std::string>() + "; its file stays\n";
    }
    context.result(text, {{"removed", scan.name}, {"models_left", left}});
  });
}

}  // namespace lightstage::cli
