#include "cli/jobs/mask.h"

#include <nlohmann/json.hpp>

#include "align/subject_mask.h"
#include "cli/jobs/provenance.h"
#include "cli/options.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

void store_subject_masks(db::Store& store, const db::Scan& scan) {
  const int key = key_step(scan);
  if (key < 0) return;
  for (const std::string& camera : scan.cameras) {
    const core::Image dark = db::dark_level(store, scan, camera);
    for (const db::Frame& frame : store.frames(scan.id, camera)) {
      if (frame.step_index != key) continue;
      const core::Image mask = align::subject_mask(db::load_frame(store, frame, dark));
      db::NewProduct product;
      product.kind = "mask";
      product.scan_id = scan.id;
      product.parameters = json_text({{"camera", camera}, {"step", key}});
      product.input_scans = {scan.id};
      product.images = {{.role = "mask", .index = key, .object = store.put_object(mask)}};
      store.add_product(product);
    }
  }
}

}  // namespace lightstage::cli
