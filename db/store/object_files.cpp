#include "db/store/object_files.h"

#include <algorithm>

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/sync_folder.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kExtension = ".exr";

}  // namespace

void sync_folder(const fs::path& folder) {
  try {
    core::sync_folder(folder);
  } catch (const core::BadInput& error) {  // here it is the store's disk
    throw core::StoreError(error.what());
  }
}

fs::path ObjectFiles::path(const ContentHash& hash) const {
  const std::string name = hash.hex();
  return folder() / name.substr(0, 2) / (name + kExtension);
}

// What failed while an object was written is the disk: its bytes are sound.
template <class Work>
auto ObjectFiles::placing(const Work& work) const {
  try {
    return work();
  } catch (const core::BadInput& error) {
    throw core::StoreError(error.what());
  } catch (const fs::filesystem_error& error) {
    throw core::StoreError(error.path1().string() + ": cannot be written: " + error.code().message());
  }
}

// Where the object goes, its folder made.
fs::path ObjectFiles::place_for(const ContentHash& hash) const {
  const fs::path target = path(hash);
  // Links that came with a stranger's store would be written through.
  if (fs::is_symlink(target.parent_path())) {
    throw core::StoreError(target.parent_path().string() +
                           ": is a symbolic link; objects lie in the store's own folders");
  }
  if (fs::is_symlink(target)) fs::remove(target);
  fs::create_directories(target.parent_path());
  return target;
}

UnsyncedObject ObjectFiles::begin(core::ImageView image, bool compressed) const {
  if (image.empty()) throw core::BadInput("an image without pixels cannot be stored");
  if (image.channels() > 4) {
    throw core::BadInput("an image of " + std::to_string(image.channels()) + " channels cannot be stored (at most 4)");
  }
  std::vector<unsigned char> bytes;
  try {
    bytes = core::encode_image(std::string("object") + kExtension, image,
                               {.pixel_type = core::PixelType::kHalf, .compressed = compressed});
  } catch (const core::BadInput&) {  // not asked before: looking costs as much as encoding
    core::require_finite(image, "image to store");
    throw;
  }
  const ContentHash hash = hash_bytes(bytes);
  return placing([&] { return UnsyncedObject{core::UnsyncedFile(place_for(hash), bytes), hash, image.size()}; });
}

void ObjectFiles::finish(std::span<UnsyncedObject* const> objects) const {
  std::vector<core::UnsyncedFile*> files;
  for (UnsyncedObject* object : objects) files.push_back(&object->file);
  placing([&] {
    core::UnsyncedFile::keep(files);
    // Whoever made the objects' folders may not have come to this line yet. Of a folder that has not changed it costs next to nothing.
    sync_folder(folder());
  });
}

ContentHash ObjectFiles::write(core::ImageView image) const {
  UnsyncedObject object = begin(image, true);
  UnsyncedObject* const all[] = {&object};
  finish(all);
  return object.hash;
}

std::uintmax_t ObjectFiles::adopt(const fs::path& file, const ContentHash& hash) const {
  std::uintmax_t size = 0;
  placing([&] {
    core::replace_file_atomically(place_for(hash), [&](const fs::path& temporary) {
      fs::copy_file(file, temporary);
      if (hash_file(temporary) != hash) throw core::StoreError(file.string() + ": its bytes do not match its name");
      size = fs::file_size(temporary);
    });
    sync_folder(folder());
  });
  return size;
}

bool ObjectFiles::exists(const ContentHash& hash) const {
  std::error_code error;
  return fs::exists(path(hash), error);
}

std::optional<std::string> ObjectFiles::problem(const ContentHash& hash) const {
  const fs::path file = path(hash);
  if (!exists(hash)) return "is missing";
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
  const auto note = [&](const fs::directory_entry& entry) {
    std::error_code vanished;  // a file that is being written may be renamed at any moment
    if (!entry.is_regular_file(vanished)) return;
    const fs::path& file = entry.path();
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
  };
  try {
    // Not by increment(error), which ends the program where memory is short.
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder())) note(entry);
  } catch (const fs::filesystem_error& error) {
    throw core::StoreError(folder().string() + ": cannot be listed: " + error.code().message());
  }
  std::sort(listing.objects.begin(), listing.objects.end());
  std::sort(listing.strangers.begin(), listing.strangers.end());
  return listing;
}

}  // namespace lightstage::db
