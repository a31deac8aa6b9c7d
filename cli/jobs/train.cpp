#include "cli/jobs/train.h"

#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "db/content_hash.h"

namespace lightstage::cli {

namespace {

core::OlatScan without_held_out(const core::OlatScan& scan, int every) {
  if (every == 0) return scan;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < scan.light_count(); ++i) {
    if (i % std::size_t(every) != 0) kept.push_back(i);
  }
  return scan.with_lights(kept);
}

}  // namespace

model::TrainReport train_on_scans(db::Store& store, const std::vector<std::string>& scans,
                                  const model::TrainOptions& options, const std::filesystem::path& out) {
  store.require_writable();
  std::vector<core::OlatScan> loaded_scans;
  db::NewProduct product;
  product.kind = "weights";
  for (const std::string& name : scans) {
    const db::LoadedScan loaded = load_scan(store, name);
    loaded_scans.push_back(without_held_out(loaded.scan, options.held_out_every));
    product.input_scans.push_back(store.scan(name).id);
    for (const auto& input : {loaded.calibration_id, loaded.alignment_id}) {
      if (input) product.input_products.push_back(*input);
    }
  }
  model::TrainReport report = model::train(loaded_scans, options, out);

  const std::filesystem::path file = std::filesystem::canonical(out);
  product.parameters = json_text({{"file", file.string()},
                                  {"hash", db::hash_file(file).hex()},
                                  {"steps", report.steps},
                                  {"held_out_every", options.held_out_every}});
  store.add_product(product);
  return report;
}

}  // namespace lightstage::cli
