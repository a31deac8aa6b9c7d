// The files behind the catalogue: one EXR an object, objects/ab/abcdef….exr, named by the hash of its bytes.
// Needs no database connection; all functions may be called from several threads.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/image.h"
#include "db/content_hash.h"
#include "db/unsynced_object.h"

namespace lightstage::db {

// Makes the names in a folder durable. Throws StoreError.
void sync_folder(const std::filesystem::path& folder);

class ObjectFiles {
 public:
  explicit ObjectFiles(std::filesystem::path store_folder) : store_folder_(std::move(store_folder)) {}

  // The first half of writing: encodes half floats, with ZIP compression or none, and leaves the file on its way to the disk. Throws as write.
  UnsyncedObject begin(core::ImageView image, bool compressed) const;
  // The second half, for many at once: returns once files and names are durable. What has a name already is replaced by the same bytes.
  // Throws StoreError when the disk fails.
  void finish(std::span<UnsyncedObject* const> objects) const;
  // Writes half floats, ZIP-compressed, and returns once file and name are durable. What has that name already is replaced by the same bytes
  // (so that it is as young as any new object). Throws BadInput for an image that is empty or not finite
  // or has more than 4 channels, StoreError when the disk fails.
  ContentHash write(core::ImageView image) const;

  // As a file in a folder, not as a link to one.
  bool exists(const ContentHash& hash) const;
  // Throws StoreError when the object is missing or damaged.
  core::Image read(const ContentHash& hash) const;
  // From the file's header alone, which does not prove the rest sound. Throws as read.
  core::ImageSize read_size(const ContentHash& hash) const;

  // Copies a file here whose bytes match that name, durable when it returns; returns its size. Throws StoreError when they do not match (nothing has
  // changed then) or the disk fails.
  std::uintmax_t adopt(const std::filesystem::path& file, const ContentHash& hash) const;

  std::filesystem::path folder() const { return store_folder_ / "objects"; }
  std::filesystem::path path(const ContentHash& hash) const;

  // "is missing", "is damaged: ...", or nothing for an object whose bytes match its name. Links, pipes and the like are damage; they are not opened.
  std::optional<std::string> problem(const ContentHash& hash) const;
  // Whether no file can be put in its place, because a folder, pipe, socket or device stands there, or a link or file in the place of its folder.
  bool is_blocked(const ContentHash& hash) const;

  struct Obstacle {
    std::filesystem::path place;
    std::string what;                   // "is a pipe"
    std::optional<ContentHash> object;  // in whose place it stands
  };
  struct Listing {
    std::vector<ContentHash> objects;              // in order of name
    std::vector<std::filesystem::path> strangers;  // files that are no objects: interrupted writes and the like
    // What no write leaves: links, pipes and the like, and whatever stands in the place of an object or of a folder for them.
    std::vector<Obstacle> obstacles;
  };
  Listing list() const;

 private:
  template <class Work>
  auto placing(const Work& work) const;
  std::filesystem::path place_for(const ContentHash& hash) const;

  std::filesystem::path store_folder_;
};

}  // namespace lightstage::db
