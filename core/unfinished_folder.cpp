#include "core/unfinished_folder.h"

#include "core/error.h"
#include "core/remove_folder.h"

namespace lightstage::core {

namespace fs = std::filesystem;

UnfinishedFolder::UnfinishedFolder(const fs::path& target)
    : target_(fs::absolute(target / "").lexically_normal().parent_path()), path_(target_.string() + ".unfinished") {
  std::error_code error;
  if (fs::exists(target_, error) && (!fs::is_directory(target_, error) || !fs::is_empty(target_, error))) {
    throw UsageError(target_.string() + ": is there already and not an empty folder; choose another");
  }
  if (fs::exists(path_, error)) {
    throw UsageError(path_.string() + ": left by an export that was interrupted, or one that is running; remove it");
  }
  fs::create_directories(path_, error);
  if (error) throw BadInput(path_.string() + ": cannot be made: " + error.message());
}

UnfinishedFolder::~UnfinishedFolder() {
  if (!finished_) remove_folder_quietly(path_);
}

void UnfinishedFolder::finish() {
  std::error_code error;
  fs::rename(path_, target_, error);  // replaces an empty folder
  if (error) throw BadInput(target_.string() + ": cannot be made: " + error.message());
  finished_ = true;
}

}  // namespace lightstage::core
