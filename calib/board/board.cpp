#include "calib/board.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "core/display.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::calib {

namespace {

constexpr int kFewestCharucoCorners = 6;

const std::map<std::string, int>& dictionaries() {
  using namespace cv::aruco;
  static const std::map<std::string, int> known{{"4x4_50", DICT_4X4_50},
                                                {"4x4_100", DICT_4X4_100},
                                                {"4x4_250", DICT_4X4_250},
                                                {"4x4_1000", DICT_4X4_1000},
                                                {"5x5_50", DICT_5X5_50},
                                                {"5x5_100", DICT_5X5_100},
                                                {"5x5_250", DICT_5X5_250},
                                                {"5x5_1000", DICT_5X5_1000},
                                                {"6x6_50", DICT_6X6_50},
                                                {"6x6_100", DICT_6X6_100},
                                                {"6x6_250", DICT_6X6_250},
                                                {"6x6_1000", DICT_6X6_1000},
                                                {"7x7_50", DICT_7X7_50},
                                                {"7x7_100", DICT_7X7_100},
                                                {"7x7_250", DICT_7X7_250},
                                                {"7x7_1000", DICT_7X7_1000},
                                                {"aruco_original", DICT_ARUCO_ORIGINAL}};
  return known;
}

cv::Ptr<cv::aruco::Dictionary> dictionary_of(const Board& board) {
  const auto known = dictionaries().find(board.dictionary);
  if (known == dictionaries().end()) {
    std::vector<std::string> names;
    for (const auto& [name, number] : dictionaries()) names.push_back(name);
    throw core::BadInput("board: there is no dictionary '" + board.dictionary + "'" +
                         core::did_you_mean(board.dictionary, names) + "; they are " + core::joined(names, ", "));
  }
  return cv::aruco::getPredefinedDictionary(known->second);
}

cv::Ptr<cv::aruco::CharucoBoard> charuco(const Board& board) {
  return cv::aruco::CharucoBoard::create(board.columns, board.rows, float(board.square_m), float(board.marker_m),
                                         dictionary_of(board));
}

// Display values in [0, 1], 1 at the picture's bright end: sensors count light, detectors look for edges in what people see.
cv::Mat encoded(core::ImageView picture) {
  const core::Image luminance = core::to_luminance(picture);
  const double bright = std::max(1e-12, core::quantile(luminance.values(), 0.995));
  cv::Mat result(luminance.height(), luminance.width(), CV_32F);
  for (int y = 0; y < luminance.height(); ++y) {
    for (int x = 0; x < luminance.width(); ++x) {
      result.at<float>(y, x) = std::clamp(core::display_encode(float(double(luminance(y, x)) / bright)), 0.0F, 1.0F);
    }
  }
  return result;
}

cv::Mat in_8_bits(const cv::Mat& picture) {
  cv::Mat result;
  picture.convertTo(result, CV_8U, 255);
  return result;
}

// By cornerSubPix, in windows of half a side of `share` of the way to the nearest other corner, so that only this corner's edges are in them.
void refine(const cv::Mat& picture, std::vector<cv::Point2f>& corners, double share) {
  constexpr int kSmallest = 2, kLargest = 15;  // pixels; wider windows see the lens bend the edges
  const std::vector<cv::Point2f> start = corners;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    double nearest = 1e9;
    for (std::size_t k = 0; k < start.size(); ++k) {
      if (k != i) nearest = std::min(nearest, cv::norm(start[k] - start[i]));
    }
    const int window = std::clamp(int(share * nearest), kSmallest, kLargest);
    std::vector<cv::Point2f> one{start[i]};
    cv::cornerSubPix(picture, one, cv::Size(window, window), cv::Size(-1, -1),
                     cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 60, 1e-3));
    // Corners that leave the window come back as they were.
    corners[i] = one.front();
  }
}

// A chessboard's corners in the order of the board frame, as far as the picture tells.
std::vector<cv::Point2f> in_board_order(const cv::Mat& picture, const Board& board, std::vector<cv::Point2f> corners) {
  const int columns = board.columns - 1, rows = board.rows - 1;
  const auto at = [&](int row, int column) -> cv::Point2f& { return corners[std::size_t(row * columns + column)]; };
  const cv::Point2f across = at(0, columns - 1) + at(rows - 1, columns - 1) - at(0, 0) - at(rows - 1, 0);
  const cv::Point2f down = at(rows - 1, 0) + at(rows - 1, columns - 1) - at(0, 0) - at(0, columns - 1);
  if (across.cross(down) < 0) {
    for (int row = 0; row < rows; ++row) std::reverse(&at(row, 0), &at(row, 0) + columns);
  }
  double like_first = 0, others = 0;  // brightness of the squares coloured as the top left one, and of the others
  int like_first_count = 0, others_count = 0;
  for (int row = 0; row + 1 < rows; ++row) {
    for (int column = 0; column + 1 < columns; ++column) {
      const cv::Point2f middle =
          (at(row, column) + at(row, column + 1) + at(row + 1, column) + at(row + 1, column + 1)) / 4;
      const double value = picture.at<float>(std::clamp(int(std::lround(middle.y)), 0, picture.rows - 1),
                                             std::clamp(int(std::lround(middle.x)), 0, picture.cols - 1));
      if ((row + column) % 2 == 0) {
        like_first += value;
        ++like_first_count;
      } else {
        others += value;
        ++others_count;
      }
    }
  }
  const bool first_is_black = others_count == 0 || like_first / like_first_count < others / others_count;
  const bool upside_down = !board.looks_same_upside_down() && !first_is_black;
  // Where the picture does not tell, the end that is up in it.
  if (board.looks_same_upside_down() ? across.x + down.y < 0 : upside_down)
    std::reverse(corners.begin(), corners.end());
  return corners;
}

BoardSeen find_chessboard(const cv::Mat& picture, const Board& board, CornerMethod method) {
  constexpr double kWindowShare = 0.4, kLargestSide = 1600;
  const cv::Size size(board.columns - 1, board.rows - 1);
  const double scale = std::min(1.0, kLargestSide / std::max(picture.cols, picture.rows));
  cv::Mat looked_at = picture;
  if (method == CornerMethod::kEither && scale < 1) cv::resize(picture, looked_at, {}, scale, scale, cv::INTER_AREA);
  const cv::Mat shown = in_8_bits(looked_at);
  std::vector<cv::Point2f> corners;
  bool found = false;
  if (method != CornerMethod::kSectors) {
    found = cv::findChessboardCorners(
        shown, size, corners, cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_FAST_CHECK);
  }
  if (!found && method != CornerMethod::kClassic) {
    found = cv::findChessboardCornersSB(shown, size, corners,
                                        cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY);
  }
  if (found && method != CornerMethod::kSectors) {
    const double back = double(picture.cols) / looked_at.cols;
    for (cv::Point2f& corner : corners) {
      corner = {float((double(corner.x) + 0.5) * back - 0.5), float((double(corner.y) + 0.5) * back - 0.5)};
    }
    refine(picture, corners, kWindowShare);
  }
  BoardSeen seen;
  if (!found || int(corners.size()) != board.corner_count()) {
    seen.reason = "no chessboard of " + std::to_string(board.columns) + " x " + std::to_string(board.rows) +
                  " squares: it must be in the picture as a whole, sharp, and have a white margin";
    return seen;
  }
  corners = in_board_order(picture, board, std::move(corners));
  for (int i = 0; i < board.corner_count(); ++i) {
    seen.corners.push_back({i, {corners[std::size_t(i)].x, corners[std::size_t(i)].y}});
  }
  return seen;
}

// Second singular value of the corners about their mean, in board units: 0 in a line.
bool in_a_line(const std::vector<BoardCorner>& corners, const Board& board) {
  return std::all_of(corners.begin(), corners.end(), [&](const BoardCorner& c) {
    const core::Vec3 a = board.corner(corners.front().id), b = board.corner(corners.back().id), p = board.corner(c.id);
    return norm(cross(b - a, p - a)) < 1e-6 * board.square_m * board.square_m;
  });
}

BoardSeen find_charuco(const cv::Mat& picture, const Board& board) {
  const cv::Mat picture_8 = in_8_bits(picture);
  const cv::Ptr<cv::aruco::CharucoBoard> pattern = charuco(board);
  const cv::Ptr<cv::aruco::DetectorParameters> parameters = cv::aruco::DetectorParameters::create();
  const auto markers_in = [&](const cv::Mat& image, std::vector<std::vector<cv::Point2f>>& corners,
                              std::vector<int>& ids) {
    cv::aruco::detectMarkers(image, pattern->dictionary, corners, ids, parameters);
  };
  std::vector<std::vector<cv::Point2f>> markers;
  std::vector<int> marker_ids;
  markers_in(picture_8, markers, marker_ids);
  BoardSeen seen;
  std::vector<cv::Point2f> corners;
  std::vector<int> ids;
  if (!marker_ids.empty()) {
    cv::aruco::interpolateCornersCharuco(markers, marker_ids, picture_8, pattern, corners, ids);
  }
  if (int(corners.size()) < kFewestCharucoCorners) {
    cv::Mat mirrored;
    cv::flip(picture_8, mirrored, 1);
    std::vector<std::vector<cv::Point2f>> mirrored_markers;
    std::vector<int> mirrored_ids;
    markers_in(mirrored, mirrored_markers, mirrored_ids);
    if (mirrored_ids.size() > marker_ids.size() + 3) {
      seen.reason = "the board is mirrored: flip the pictures, or look at it past the mirror";
    } else if (marker_ids.empty()) {
      seen.reason = "no marker of dictionary " + board.dictionary +
                    " was found: the board is not in the picture, too small, too blurred, or of another kind";
    } else {
      seen.reason = std::to_string(marker_ids.size()) + " markers and " + std::to_string(corners.size()) +
                    " corners between them were found; at least " + std::to_string(kFewestCharucoCorners) +
                    " corners are needed: show more of the board, and see that its size is given right";
    }
    return seen;
  }
  refine(picture, corners, 0.9 * 0.5 * (1 - board.marker_m / board.square_m));
  for (std::size_t i = 0; i < corners.size(); ++i) {
    // Half a pixel from the edge the window holds half a corner.
    constexpr float kBorder = 3;
    const cv::Point2f p = corners[i];
    if (p.x < kBorder || p.y < kBorder || p.x > float(picture.cols - 1) - kBorder ||
        p.y > float(picture.rows - 1) - kBorder) {
      continue;
    }
    seen.corners.push_back({ids[i], {p.x, p.y}});
  }
  std::sort(seen.corners.begin(), seen.corners.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  if (int(seen.corners.size()) < kFewestCharucoCorners || in_a_line(seen.corners, board)) {
    seen.corners.clear();
    seen.reason = "the corners found lie in one line or at the picture's edge: show more of the board";
  }
  return seen;
}

}  // namespace

void require_usable(const Board& board) {
  const std::string size = std::to_string(board.columns) + " x " + std::to_string(board.rows);
  if (board.columns < 3 || board.rows < 3 || board.columns > 100 || board.rows > 100) {
    throw core::BadInput("board: " + size + " squares; columns and rows must be 3 to 100");
  }
  if (!(board.square_m > 0) || !std::isfinite(board.square_m)) {
    throw core::BadInput("board: the squares' side must be above 0");
  }
  if (board.kind == BoardKind::kChessboard) {
    if (board.columns == board.rows) {
      throw core::BadInput(
          "board: a chessboard of " + size +
          " squares looks the same when turned by a quarter; use one with unequal sides, or a ChArUco board");
    }
    return;
  }
  if (!(board.marker_m > 0 && board.marker_m < 0.95 * board.square_m)) {
    throw core::BadInput("board: the markers' side must be above 0 and below 0.95 of the squares'");
  }
  const int markers = board.columns * board.rows / 2, known = dictionary_of(board)->bytesList.rows;
  if (markers > known) {
    throw core::BadInput("board: " + size + " squares need " + std::to_string(markers) + " markers; dictionary " +
                         board.dictionary + " has " + std::to_string(known) + ": take a larger one");
  }
}

core::Image board_picture(const Board& board, int pixels_per_square, int margin_px) {
  require_usable(board);
  const cv::Size size(board.columns * pixels_per_square, board.rows * pixels_per_square);
  cv::Mat field(size, CV_8U, cv::Scalar(255));
  if (board.kind == BoardKind::kCharuco) {
    const int needed = dictionary_of(board)->markerSize + 2;  // a pixel for each bit and the border
    if (pixels_per_square * board.marker_m / board.square_m < needed) {
      throw core::BadInput("board: its markers would be fewer than " + std::to_string(needed) +
                           " pixels wide; make them larger, or print with more dots per inch");
    }
    charuco(board)->draw(size, field, 0, 1);
  } else {
    for (int row = 0; row < board.rows; ++row) {
      for (int column = row % 2; column < board.columns; column += 2) {
        field(cv::Rect(column * pixels_per_square, row * pixels_per_square, pixels_per_square, pixels_per_square)) = 0;
      }
    }
  }
  core::Image picture(size.height + 2 * margin_px, size.width + 2 * margin_px, 1);
  std::fill(picture.values().begin(), picture.values().end(), 1.0F);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      picture(y + margin_px, x + margin_px) = field.at<unsigned char>(y, x) >= 128 ? 1.0F : 0.0F;
    }
  }
  return picture;
}

BoardSeen find_board(core::ImageView picture, const Board& board, CornerMethod method) {
  require_usable(board);
  constexpr int kSmallestSide = 32;
  if (picture.width() < kSmallestSide || picture.height() < kSmallestSide) {
    return {{},
            "the picture is too small: " + std::to_string(picture.width()) + " x " + std::to_string(picture.height()) +
                " pixels"};
  }
  const cv::Mat shown = encoded(picture);
  return board.kind == BoardKind::kCharuco ? find_charuco(shown, board) : find_chessboard(shown, board, method);
}

}  // namespace lightstage::calib
