#include "cli/jobs/board_pictures.h"

#include <algorithm>
#include <map>

#include "cli/jobs/ball_pass.h"
#include "cli/jobs/picture_folder.h"
#include "cli/jobs/provenance.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/text.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace fs = std::filesystem;

namespace {

// The folder itself where it holds pictures, else those below it that do, in the order of their names.
std::vector<fs::path> camera_folders(const fs::path& folder) {
  const bool itself = !pictures_in(folder).empty();
  std::vector<fs::path> folders;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->is_directory() && !pictures_in(entry->path()).empty()) folders.push_back(entry->path());
  }
  if (itself && !folders.empty()) {
    throw core::BadInput("'" + folder.string() + "' holds pictures, and so does '" +
                         folders.front().filename().string() +
                         "' in it: put every camera's pictures into a folder of its own, and nothing beside them");
  }
  if (itself) return {folder};
  if (folders.empty()) {
    throw core::BadInput("'" + folder.string() + "': there are no pictures in it, nor in folders below it");
  }
  std::sort(folders.begin(), folders.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return folders;
}

// The commonest size that pictures of the folder claim; those that claim nothing are damaged.
core::ImageSize picture_size(const fs::path& folder, const std::vector<std::string>& names) {
  std::map<std::pair<int, int>, int> count;
  std::string first_problem;
  for (const std::string& name : names) {
    try {
      const core::ImageSize size = core::read_image_size(folder / name);
      ++count[{size.width, size.height}];
    } catch (const core::BadInput& error) {
      if (first_problem.empty()) first_problem = error.what();
    }
  }
  if (count.empty()) throw core::BadInput(first_problem);
  const auto most =
      std::max_element(count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return {most->first.second, most->first.first, 1};
}

}  // namespace

BoardPictures loose_board_pictures(const fs::path& folder, const calib::Board& board,
                                   const std::optional<capture::Stage>& stage) {
  BoardPictures result;
  result.board = board;
  std::map<std::string, std::size_t> instants;
  const std::vector<fs::path> folders = camera_folders(folder);
  for (const fs::path& camera_folder : folders) {
    const std::string name = fs::absolute(camera_folder / "").lexically_normal().parent_path().filename().string();
    const std::vector<std::string> names = pictures_in(camera_folder);
    const core::ImageSize size = picture_size(camera_folder, names);
    const std::size_t camera = result.cameras.size();
    result.cameras.push_back({name, size.width, size.height});
    if (stage) {
      // A single camera's folder may have any name.
      const bool only_one = folders.size() == 1 && stage->cameras.size() == 1;
      result.drawn.push_back(only_one ? stage->cameras.front() : camera_of(*stage, name));
      result.cameras.back().name = result.drawn.back().name;
    }
    for (const std::string& picture : names) {
      const std::size_t instant = instants.emplace(fs::path(picture).stem().string(), instants.size()).first->second;
      result.pictures.push_back({camera, instant, (folders.size() > 1 ? name + "/" : "") + picture,
                                 [path = camera_folder / picture] { return core::read_image(path); }});
    }
  }
  std::stable_sort(result.pictures.begin(), result.pictures.end(), [](const auto& a, const auto& b) {
    return std::pair(a.instant, a.camera) < std::pair(b.instant, b.camera);
  });
  return result;
}

BoardPictures board_passes(const db::Store& store, const std::vector<std::string>& scans, const calib::Board& board) {
  BoardPictures result;
  result.board = board;
  std::size_t instant = 0;
  for (const std::string& name : scans) {
    // Counted twice, its corners would promise errors that nothing was measured for.
    if (std::count(scans.begin(), scans.end(), name) > 1) throw core::UsageError("scan '" + name + "' is named twice");
    const db::Scan scan = ball_pass(store, name, db::ScanKind::kChessboard, "chessboard (`capture --chessboard`)");
    const capture::Stage stage = capture_provenance(scan).stage;
    if (result.scans.empty()) {
      result.stage_key = scan.stage_key;
      result.drawn = stage.cameras;
      for (const capture::StageCamera& camera : stage.cameras) {
        result.cameras.push_back({camera.name, camera.model.width, camera.model.height});
      }
    } else if (scan.stage_key != result.stage_key || scan.cameras.size() != result.cameras.size()) {
      throw core::UsageError("scan '" + name + "' stands on another stage than '" + scans.front() + "'");
    }
    result.scans.push_back(scan.id);
    std::map<int, std::size_t> instant_of_step;
    for (const db::Frame& frame : store.frames(scan.id)) {
      const db::StepKind kind = db::step_of(scan, frame.step_index).kind;
      if (kind == db::StepKind::kDark || kind == db::StepKind::kLight) continue;
      const auto camera = std::find_if(result.cameras.begin(), result.cameras.end(),
                                       [&](const auto& c) { return c.name == frame.camera; });
      if (camera == result.cameras.end()) {
        throw core::UsageError("scan '" + name + "' has a camera '" + frame.camera + "' that '" + scans.front() +
                               "' has not");
      }
      const auto [step, is_new] = instant_of_step.emplace(frame.step_index, instant);
      if (is_new) ++instant;
      result.pictures.push_back({std::size_t(camera - result.cameras.begin()), step->second,
                                 name + " step " + std::to_string(frame.step_index) + ", " + frame.camera,
                                 // Objects need no connection, and darkness does not move corners.
                                 [&store, object = frame.object] { return store.object(object); }});
    }
    if (instant_of_step.empty()) {
      throw core::BadInput(
          "scan '" + name +
          "' has no frames under all lights; the board is looked for in those (`capture --chessboard`)");
    }
  }
  return result;
}

}  // namespace lightstage::cli
