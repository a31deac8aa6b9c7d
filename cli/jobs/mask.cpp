#include "cli/jobs/mask.h"

#include <nlohmann/json.hpp>

#include "align/subject_mask.h"
#include "capture/sequence.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

void store_subject_masks(db::Store& store, const db::Scan& scan) {
  const int key = capture::key_step(scan.steps);
  if (key < 0) return;
  db::NewProduct product;
  product.kind = "mask";
  product.scan_id = scan.id;
  product.parameters = nlohmann::ordered_json{{"step", key}}.dump();
  product.input_scans = {scan.id};
  for (std::size_t camera = 0; camera < scan.cameras.size(); ++camera) {
    const core::Image dark = db::dark_level(store, scan, scan.cameras[camera]);
    for (const db::Frame& frame : store.frames(scan.id, scan.cameras[camera])) {
      if (frame.step_index != key) continue;
      const core::Image mask = align::subject_mask(db::load_frame(store, frame, dark));
      product.images.push_back({.role = "mask", .index = int(camera), .object = store.put_object(mask)});
    }
  }
  store.add_product(product);
}

}  // namespace lightstage::cli
