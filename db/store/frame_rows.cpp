// Store: frames.
#include "core/error.h"
#include "core/text.h"
#include "db/store/impl.h"

namespace lightstage::db {
namespace {

constexpr const char* kFrameColumns =
    "SELECT f.id, f.scan_id, f.camera, f.step_index, f.timestamp_ns, f.sequence_number, f.attempt, "
    "f.saturation, f.object "
    "FROM frames f JOIN cameras c ON c.scan_id = f.scan_id AND c.name = f.camera ";

std::vector<Frame> read_frames(const std::string& store_folder, SQLite::Statement row) {
  const std::string what = store_folder + ": a frame's row: ";
  std::vector<Frame> frames;
  while (row.executeStep()) {
    Frame frame;
    frame.id = row.getColumn(0).getInt64();
    frame.scan_id = row.getColumn(1).getInt64();
    frame.camera = row.getColumn(2).getString();
    frame.step_index = int_at(row, 3, what + "step");
    frame.timestamp_ns = row.getColumn(4).getInt64();
    frame.sequence_number = row.getColumn(5).getInt64();
    frame.attempt = int_at(row, 6, what + "attempt");
    frame.saturation = row.getColumn(7).getDouble();
    if (!(frame.saturation >= 0)) throw core::StoreError(what + "its saturation is not a number >= 0");
    frame.object = ContentHash::from_hex(row.getColumn(8).getString());
    frames.push_back(std::move(frame));
  }
  return frames;
}

std::string to_text(core::ImageSize size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + " with " +
         core::counted(std::size_t(size.channels), "channel");
}

}  // namespace

void Store::Impl::check_frame(const NewFrame& frame, core::ImageSize size) const {
  auto scan = query("SELECT name FROM scans WHERE id = ?", frame.scan_id);
  if (!scan.executeStep()) {
    throw core::UsageError(folder.string() + ": there is no scan with id " + std::to_string(frame.scan_id));
  }
  const std::string place = folder.string() + ": scan '" + scan.getColumn(0).getString() + "', camera '" +
                            frame.camera + "', step " + std::to_string(frame.step_index) + ": ";
  if (!query("SELECT 1 FROM cameras WHERE scan_id = ? AND name = ?", frame.scan_id, frame.camera).executeStep()) {
    throw core::BadInput(place + "the scan has no such camera");
  }
  if (!query("SELECT 1 FROM steps WHERE scan_id = ? AND step_index = ?", frame.scan_id, frame.step_index)
           .executeStep()) {
    throw core::BadInput(place + "the scan has no such step");
  }
  if (frame.attempt < 1) throw core::BadInput(place + "attempts count from 1");
  if (!(frame.saturation >= 0)) throw core::BadInput(place + "its saturation is not a number >= 0");
  auto other = query(
      "SELECT o.height, o.width, o.channels FROM frames f JOIN objects o ON o.hash = f.object "
      "WHERE f.scan_id = ? AND f.camera = ? AND f.step_index <> ? LIMIT 1",
      frame.scan_id, frame.camera, frame.step_index);
  if (!other.executeStep()) return;
  const core::ImageSize expected{other.getColumn(0).getInt(), other.getColumn(1).getInt(), other.getColumn(2).getInt()};
  if (expected != size) {
    throw core::BadInput(place + "the image is " + to_text(size) + ", the camera's other frames are " +
                         to_text(expected));
  }
}

Id Store::Impl::enter_frame(const NewFrame& frame, const ContentHash& object, core::ImageSize size) {
  check_frame(frame, size);
  know_object(object, size);
  change(
      "INSERT OR REPLACE INTO frames "
      "(scan_id, camera, step_index, timestamp_ns, sequence_number, attempt, saturation, object) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
      frame.scan_id, frame.camera, frame.step_index, frame.timestamp_ns, frame.sequence_number, frame.attempt,
      frame.saturation, object);
  return Id(database.getLastInsertRowid());
}

Id Store::put_frame(const NewFrame& frame, core::ImageView image) {
  // Before the object is written, so that a frame that cannot be taken leaves nothing behind.
  explaining(folder(), [&] { impl_->check_frame(frame, image.size()); });
  return add_frame(frame, put_object(image));
}

Id Store::add_frame(const NewFrame& frame, const ContentHash& object) {
  return impl_->write([&] { return impl_->enter_frame(frame, object, impl_->size_of(object)); });
}

UnsyncedFrame Store::begin_frame(const NewFrame& frame, core::ImageView image) const {
  return {frame, impl_->objects.begin(image, false)};
}

std::vector<Id> Store::finish_frames(std::vector<UnsyncedFrame> frames) {
  explaining(folder(), [&] {
    for (const UnsyncedFrame& unsynced : frames) impl_->check_frame(unsynced.frame, unsynced.object.size);
  });
  std::vector<UnsyncedObject*> objects;
  for (UnsyncedFrame& unsynced : frames) objects.push_back(&unsynced.object);
  impl_->objects.finish(objects);
  return impl_->write([&] {
    std::vector<Id> ids;
    for (const UnsyncedFrame& unsynced : frames) {
      ids.push_back(impl_->enter_frame(unsynced.frame, unsynced.object.hash, unsynced.object.size));
    }
    return ids;
  });
}

std::vector<Frame> Store::frames(Id scan_id, std::string_view camera) const {
  return explaining(folder(), [&] {
    const std::string sql = std::string(kFrameColumns) + "WHERE f.scan_id = ? AND f.camera = ? ORDER BY f.step_index";
    return read_frames(folder().string(), impl_->query(sql.c_str(), scan_id, camera));
  });
}

std::vector<Frame> Store::frames(Id scan_id) const {
  return explaining(folder(), [&] {
    const std::string sql = std::string(kFrameColumns) + "WHERE f.scan_id = ? ORDER BY f.step_index, c.position";
    return read_frames(folder().string(), impl_->query(sql.c_str(), scan_id));
  });
}

}  // namespace lightstage::db
