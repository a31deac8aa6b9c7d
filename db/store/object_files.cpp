#include "db/store/object_files.h"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/sync_folder.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kExtension = ".exr";

std::string kind_of(const struct stat& status) {
  if (S_ISLNK(status.st_mode)) return "a symbolic link";
  if (S_ISDIR(status.st_mode)) return "a folder";
  if (S_ISREG(status.st_mode)) return "a file";
  if (S_ISFIFO(status.st_mode)) return "a pipe";
  if (S_ISSOCK(status.st_mode)) return "a socket";
  return "a device";
}

// What is wrong with the folder of some objects; nothing where there is none.
std::optional<std::string> objection_to_folder(const fs::path& folder) {
  struct stat status {};
  if (::lstat(folder.c_str(), &status) != 0 || S_ISDIR(status.st_mode)) return std::nullopt;
  return "is " + kind_of(status) + "; objects lie in the store's own folders";
}

// Two digits: objects of such names go into a folder that is called so.
bool is_for_objects(const std::string& name) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  return name.size() == 2 && kDigits.find(name[0]) != kDigits.npos && kDigits.find(name[1]) != kDigits.npos;
}

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
  fs::path target = path(hash);
  const fs::path parent = target.parent_path();
  // That folder alone: where `objects` is gone the store was moved, and making it again would cut the store in two.
  if (::mkdir(parent.c_str(), 0777) != 0 && errno != EEXIST) {
    if (errno == ENOENT) {
      throw core::StoreError(folder().string() +
                             ": this folder is gone: the store was moved or removed while it was in use. Name its new "
                             "folder with --store and go on there");
    }
    throw core::StoreError(parent.string() + ": cannot be made: " + std::strerror(errno));
  }
  // Links that came with a stranger's store would be written through.
  if (const auto objection = objection_to_folder(parent)) throw core::StoreError(parent.string() + ": " + *objection);
  if (fs::is_symlink(target)) fs::remove(target);
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
  const fs::path file = path(hash);
  struct stat status {};
  return !objection_to_folder(file.parent_path()) && ::lstat(file.c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

std::optional<std::string> ObjectFiles::problem(const ContentHash& hash) const {
  const fs::path file = path(hash);
  const std::string damaged = "is damaged: ";
  if (const auto objection = objection_to_folder(file.parent_path())) {
    return damaged + file.parent_path().string() + ": " + *objection;
  }
  struct stat status {};
  if (::lstat(file.c_str(), &status) != 0) {
    return errno == ENOENT ? "is missing" : damaged + file.string() + ": " + std::strerror(errno);
  }
  // Looked at before it is opened: opening a device may do something, and what a link names may have no end.
  if (!S_ISREG(status.st_mode)) return damaged + kind_of(status) + " stands in its place (" + file.string() + ")";
  try {
    if (hash_file(file) != hash) return damaged + "its bytes do not match its name";
  } catch (const core::StoreError& unreadable) {
    return damaged + unreadable.what();
  }
  return std::nullopt;
}

bool ObjectFiles::is_blocked(const ContentHash& hash) const {
  const fs::path file = path(hash);
  if (objection_to_folder(file.parent_path())) return true;
  struct stat status {};
  return ::lstat(file.c_str(), &status) == 0 && !S_ISREG(status.st_mode) && !S_ISLNK(status.st_mode);
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
  if (!exists(hash)) {
    throw core::StoreError(store_folder_.string() + ": object " + hash.hex() + " is missing, or its file is none");
  }
  try {
    return core::read_image_size(path(hash));
  } catch (const core::BadInput& error) {
    throw core::StoreError(store_folder_.string() + ": object " + hash.hex() + ": " + error.what());
  }
}

ObjectFiles::Listing ObjectFiles::list() const {
  Listing listing;
  const auto note = [&](const fs::directory_entry& entry) {
    const fs::path& file = entry.path();
    struct stat status {};
    // What is being written may be renamed at any moment.
    if (::lstat(file.c_str(), &status) != 0) return;
    const bool top = file.parent_path() == folder();
    std::optional<ContentHash> hash;
    try {
      hash = ContentHash::from_hex(file.stem().string());
    } catch (const core::StoreError&) {
    }
    const bool object = hash && path(*hash) == file;
    if (S_ISDIR(status.st_mode) && !object) return;
    if (object && S_ISREG(status.st_mode)) {
      listing.objects.push_back(*hash);
    } else if (object || !S_ISREG(status.st_mode) || (top && is_for_objects(file.filename().string()))) {
      listing.obstacles.push_back({file, "is " + kind_of(status), object ? hash : std::nullopt});
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
  std::sort(listing.obstacles.begin(), listing.obstacles.end(),
            [](const Obstacle& a, const Obstacle& b) { return a.place < b.place; });
  return listing;
}

}  // namespace lightstage::db
