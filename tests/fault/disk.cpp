#include "fault/disk.h"

#include <algorithm>
#include <fstream>
#include <random>
#include <set>
#include <sstream>
#include <stdexcept>

namespace lightstage::fault {

namespace fs = std::filesystem;

namespace {

constexpr std::uint64_t kSector = 512;

std::string read_file(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

std::string folder_of(const std::string& path) {
  return fs::path(path).parent_path().string();
}

}  // namespace

std::vector<Change> read_record(const fs::path& file) {
  const std::string bytes = read_file(file);
  std::vector<Change> changes;
  std::size_t at = 0;
  const auto take = [&](std::size_t length) {
    if (length > bytes.size() - at) throw std::runtime_error(file.string() + ": this record is cut short");
    const std::string piece = bytes.substr(at, length);
    at += length;
    return piece;
  };
  while (at < bytes.size()) {
    RecordHeader header;
    std::copy_n(take(sizeof header).data(), sizeof header, reinterpret_cast<char*>(&header));
    Change change;
    change.kind = RecordKind(header.kind);
    change.path = take(header.path_length);
    change.to = take(header.to_length);
    change.offset = header.offset;
    change.data = take(header.data_length);
    changes.push_back(std::move(change));
  }
  return changes;
}

Disk::Disk(const fs::path& folder) : root_(fs::absolute(folder).lexically_normal().string()) {
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    std::shared_ptr<File> file;
    if (entry.is_regular_file()) {
      file = std::make_shared<File>();
      file->durable = file->seen = read_file(entry.path());
    }
    seen_[relative(fs::absolute(entry.path()).lexically_normal().string())] = file;
  }
  durable_ = seen_;
}

std::string Disk::relative(const std::string& path) const {
  return fs::path(path).lexically_normal().lexically_relative(root_).string();
}

void Disk::apply_to(std::string& bytes, const Change& change, std::uint64_t length) {
  if (change.kind == RecordKind::kTruncate) {
    bytes.resize(change.offset);
    return;
  }
  if (bytes.size() < change.offset + length) bytes.resize(change.offset + length);
  std::copy_n(change.data.begin(), length, bytes.begin() + std::ptrdiff_t(change.offset));
}

void Disk::rename(Names& names, const std::string& from, const std::string& to) {
  const auto found = names.find(from);
  if (found == names.end()) return;
  const std::shared_ptr<File> file = found->second;
  names.erase(found);
  names[to] = file;
}

void Disk::apply(const Change& change) {
  const std::string path = relative(change.path);
  const auto file_at = [&]() -> std::shared_ptr<File> {
    std::shared_ptr<File>& file = seen_[path];
    if (file == nullptr) {
      // Opened by a call that the shim does not see.
      file = std::make_shared<File>();
      pending_names_.push_back({{RecordKind::kCreate, path, {}, 0, {}}, file});
    }
    return file;
  };
  switch (change.kind) {
    case RecordKind::kCreate:
      seen_.erase(path);
      file_at();
      break;
    case RecordKind::kWrite:
    case RecordKind::kTruncate: {
      const std::shared_ptr<File> file = file_at();
      apply_to(file->seen, change, change.data.size());
      file->pending.push_back(change);
      break;
    }
    case RecordKind::kSync: {
      const auto file = seen_.find(path);
      if (file != seen_.end() && file->second != nullptr) {
        file->second->durable = file->second->seen;
        file->second->pending.clear();
        break;
      }
      // A folder: the names in it.
      const std::string folder = path == "." ? "" : path;
      std::vector<NameChange> left;
      for (NameChange& name : pending_names_) {
        const std::string place =
            folder_of(name.change.kind == RecordKind::kRename ? name.change.to : name.change.path);
        if (place != folder) {
          left.push_back(std::move(name));
          continue;
        }
        if (name.change.kind == RecordKind::kRename) rename(durable_, name.change.path, name.change.to);
        if (name.change.kind == RecordKind::kRename) durable_[name.change.to] = name.file;
        if (name.change.kind == RecordKind::kRemove) durable_.erase(name.change.path);
        if (name.change.kind == RecordKind::kCreate || name.change.kind == RecordKind::kMakeFolder)
          durable_[name.change.path] = name.file;
      }
      pending_names_ = std::move(left);
      break;
    }
    case RecordKind::kRename: {
      const std::string to = relative(change.to);
      const auto found = seen_.find(path);
      const std::shared_ptr<File> file = found == seen_.end() ? nullptr : found->second;
      rename(seen_, path, to);
      pending_names_.push_back({{change.kind, path, to, 0, {}}, file});
      break;
    }
    case RecordKind::kRemove:
      seen_.erase(path);
      pending_names_.push_back({{change.kind, path, {}, 0, {}}, nullptr});
      break;
    case RecordKind::kMakeFolder:
      seen_[path] = nullptr;
      pending_names_.push_back({{change.kind, path, {}, 0, {}}, nullptr});
      break;
  }
}

namespace {

void write_out(const fs::path& folder, const std::map<std::string, std::string>& files,
               const std::set<std::string>& folders) {
  fs::create_directories(folder);
  for (const std::string& path : folders) fs::create_directories(folder / path);
  for (const auto& [path, bytes] : files) {
    // Of a folder whose name was lost nothing can be reached.
    if (!fs::is_directory((folder / path).parent_path())) continue;
    std::ofstream(folder / path, std::ios::binary) << bytes;
  }
}

}  // namespace

void Disk::write_seen(const fs::path& folder) const {
  std::map<std::string, std::string> files;
  std::set<std::string> folders;
  for (const auto& [path, file] : seen_) {
    if (file != nullptr) {
      files[path] = file->seen;
    } else {
      folders.insert(path);
    }
  }
  write_out(folder, files, folders);
}

void Disk::write_left(const fs::path& folder, std::uint64_t seed) const {
  std::mt19937_64 random(seed);
  const auto below = [&](std::uint64_t n) { return seed == 0 ? 0 : random() % n; };
  Names names = durable_;
  std::map<std::string, std::size_t> kept;  // of each folder's changes of names
  for (const NameChange& name : pending_names_)
    ++kept[folder_of(name.change.to.empty() ? name.change.path : name.change.to)];
  for (auto& [place, count] : kept) count = below(count + 1);
  for (const NameChange& name : pending_names_) {
    std::size_t& more = kept[folder_of(name.change.to.empty() ? name.change.path : name.change.to)];
    if (more == 0) continue;
    --more;
    if (name.change.kind == RecordKind::kRename) {
      names.erase(name.change.path);
      names[name.change.to] = name.file;
    } else if (name.change.kind == RecordKind::kRemove) {
      names.erase(name.change.path);
    } else {
      names[name.change.path] = name.file;
    }
  }
  std::map<std::string, std::string> files;
  std::set<std::string> folders;
  for (const auto& [path, file] : names) {
    if (file == nullptr) {
      folders.insert(path);
      continue;
    }
    std::string bytes = file->durable;
    for (const Change& change : file->pending) {
      const std::uint64_t whole = change.data.size();
      if (below(2) == 0) continue;
      const std::uint64_t length = below(2) == 0 ? whole : std::min(whole, below(whole / kSector + 1) * kSector);
      apply_to(bytes, change, length);
    }
    files[path] = std::move(bytes);
  }
  write_out(folder, files, folders);
}

}  // namespace lightstage::fault
