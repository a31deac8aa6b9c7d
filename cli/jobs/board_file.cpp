#include "cli/jobs/board_file.h"

#include "core/config.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

calib::Board read_board(const std::filesystem::path& path) {
  const core::TomlTable table = core::TomlTable::read_file(path);
  calib::Board board;
  const std::string kind = table.string("kind");
  if (kind == "chessboard") {
    board.kind = calib::BoardKind::kChessboard;
  } else if (kind != "charuco") {
    table.fail("kind", "must be \"charuco\" or \"chessboard\"");
  }
  const auto count = [&](const char* key) {
    const std::int64_t value = table.integer(key);
    if (value < 3 || value > 100) table.fail(key, "must be 3 to 100 squares");
    return static_cast<int>(value);
  };
  board.columns = count("columns");
  board.rows = count("rows");
  board.square_m = table.number("square_mm") / 1000;
  if (board.kind == calib::BoardKind::kCharuco) {
    board.marker_m = table.number("marker_mm") / 1000;
    board.dictionary = table.string("dictionary");
  }
  table.finish();
  try {
    calib::require_usable(board);
  } catch (const core::BadInput& error) {
    throw core::BadInput(path.string() + ": " + error.what());
  }
  return board;
}

std::string to_toml(const calib::Board& board) {
  const bool charuco = board.kind == calib::BoardKind::kCharuco;
  // The shortest text that reads back; an integer would do as well.
  const auto millimetres = [](double metres) { return core::number_text(metres * 1000, 12); };
  std::string text = std::string("kind = \"") + (charuco ? "charuco" : "chessboard") + "\"\n";
  text += "columns = " + std::to_string(board.columns) + "  # squares; the top left one is black\n";
  text += "rows = " + std::to_string(board.rows) + "\n";
  text += "square_mm = " + millimetres(board.square_m) + "  # measure what the printer made of it\n";
  if (charuco) {
    text += "marker_mm = " + millimetres(board.marker_m) + "\n";
    text += "dictionary = \"" + board.dictionary + "\"\n";
  }
  return text;
}

}  // namespace lightstage::cli
