// Pictures of a calibration board by one or several cameras: loose ones, or passes in a store.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera_calibration.h"
#include "capture/stage.h"
#include "core/image.h"
#include "db/store.h"

namespace lightstage::cli {

struct BoardPicture {
  std::size_t camera = 0, instant = 0;
  std::string label;                  // for people
  std::function<core::Image()> load;  // linear; may be called from several threads
};

struct BoardPictures {
  calib::Board board;
  std::vector<calib::RigCamera> cameras;
  std::vector<BoardPicture> pictures;  // by instant, then camera
  // What stands in the stage file: cameras in the order of `cameras`; empty where there is none.
  std::vector<capture::StageCamera> drawn;
  std::string stage_key;      // of passes in a store
  std::vector<db::Id> scans;  // likewise
};

// Loose pictures: each folder below `folder` that holds pictures is a camera of that name, or `folder` itself is the only one. Pictures of
// one name, whatever their extension, were taken at one instant. With `stage`, cameras that it does not name are refused. Throws BadInput for folders without pictures.
BoardPictures loose_board_pictures(const std::filesystem::path& folder, const calib::Board& board,
                                   const std::optional<capture::Stage>& stage);

// Chessboard passes of one stage: their steps under all lights or patterns are instants. Throws UsageError for other scans, BadInput for passes
// without such steps.
BoardPictures board_passes(const db::Store& store, const std::vector<std::string>& scans, const calib::Board& board);

}  // namespace lightstage::cli
