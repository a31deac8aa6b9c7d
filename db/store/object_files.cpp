#include "db/store/object_files.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <random>

#include <fcntl.h>
#include <unistd.h>

#include "core/error.h"
#include "core/image_file.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kExtension = ".exr";

// A name nobody else uses (random: process ids repeat where containers share a folder), among the objects so
// that renaming stays on one file system. Removed at the end of the scope if it is still there.
class IncomingFile {
 public:
  explicit IncomingFile(const fs::path& objects) {
    std::random_device random;
    path_ = objects / ("incoming-" + std::to_string(random()) + "-" + std::to_string(random()) + kExtension);
  }
  ~IncomingFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  IncomingFile(const IncomingFile&) = delete;
  IncomingFile& operator=(const IncomingFile&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace

void sync_folder(const fs::path& folder) {
  const int handle = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // Some network file systems cannot sync a folder and say EINVAL; they order the rename themselves.
  const bool synced = handle >= 0 && (::fsync(handle) == 0 || errno == EINVAL);
  const int error = errno;
  if (handle >= 0) ::close(handle);
  if (!synced) throw core::StoreError(folder.string() + ": cannot be synced: " + std::strerror(error));
}

fs::path ObjectFiles::path(const ContentHash& hash) const {
  const std::string name = hash.hex();
  return folder() / name.substr(0, 2) / (name + kExtension);
}

ContentHash ObjectFiles::write(core::ImageView image) const {
  if (image.empty()) throw core::BadInput("an image without pixels cannot be stored");
  if (image.channels() > 4) {
    throw core::BadInput("an image of " + std::to_string(image.channels()) + " channels cannot be stored (at most 4)");
  }
  core::require_finite(image, "image to store");

  const IncomingFile incoming(folder());
  try {
    core::write_image(incoming.path(), image, {.pixel_type = core::PixelType::kHalf});
  } catch (const core::BadInput& error) {  // the image is sound: what is left is the disk
    throw core::StoreError(error.what());
  }
  const ContentHash hash = hash_file(incoming.path());
  const fs::path target = path(hash);
  std::error_code error;
  const bool new_folder = fs::create_directories(target.parent_path(), error);
  if (!error && problem(hash)) fs::rename(incoming.path(), target, error);
  if (error) throw core::StoreError(target.string() + ": cannot be written: " + error.message());
  // Also where the object was there before: whoever wrote it may not have come to this line yet.
  sync_folder(target.parent_path());
  if (new_folder) sync_folder(folder());
  return hash;
}

std::optional<std::string> ObjectFiles::problem(const ContentHash& hash) const {
  const fs::path file = path(hash);
  std::error_code error;
  if (!fs::exists(file, error)) return "is missing";
  try {
    if (hash_file(file) != hash) return "is damaged: its bytes do not match its name";
  } catch (const core::StoreError& unreadable) {
    return std::string("is damaged: ") + unreadable.what();
  }
  return std::nullopt;
}

core::Image ObjectFiles::read(const ContentHash& hash) const {
  const fs::path file = path(hash);
  if (const auto found = problem(hash)) {
    throw core::StoreError(store_folder_.string() + ": object " + hash.hex() + " " + *found +
                           "; `lightstage store verify` names what it belongs to");
  }
  try {
    return core::read_image(file);
  } catch (const core::BadInput& error) {
    throw core::StoreError(error.what());
  }
}

core::ImageSize ObjectFiles::read_size(const ContentHash& hash) const {
  try {
    return core::read_image_size(path(hash));
  } catch (const core::BadInput& error) {
    throw core::StoreError(store_folder_.string() + ": object " + hash.hex() + ": " + error.what());
  }
}

ObjectFiles::Listing ObjectFiles::list() const {
  Listing listing;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder(), error), end; !error && entry != end; entry.increment(error)) {
    std::error_code vanished;  // a file that is being written may be renamed at any moment
    if (!entry->is_regular_file(vanished)) continue;
    const fs::path& file = entry->path();
    std::optional<ContentHash> hash;
    try {
      hash = ContentHash::from_hex(file.stem().string());
    } catch (const core::StoreError&) {
    }
    if (hash && path(*hash) == file) {
      listing.objects.push_back(*hash);
    } else {
      listing.strangers.push_back(file);
    }
  }
  if (error) throw core::StoreError(folder().string() + ": cannot be listed: " + error.message());
  std::sort(listing.objects.begin(), listing.objects.end());
  std::sort(listing.strangers.begin(), listing.strangers.end());
  return listing;
}

}  // namespace lightstage::db
