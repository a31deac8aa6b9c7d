// Boards and their corners in pictures.
#include <catch2/catch.hpp>

#include <iostream>

#include "calib/board_rig.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/stopwatch.h"

namespace lightstage::calib {

namespace {

const Board kChessboard{.kind = BoardKind::kChessboard, .columns = 10, .rows = 7, .square_m = 0.028};
const Board kCharuco{.kind = BoardKind::kCharuco, .columns = 10, .rows = 7, .square_m = 0.028, .marker_m = 0.02};

core::Image mirrored(const core::Image& picture) {
  core::Image result(picture.size());
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = 0; x < picture.width(); ++x) result(y, x) = picture(y, picture.width() - 1 - x);
  }
  return result;
}

// Distances of the corners from where geometry puts them.
std::vector<double> errors_px(const BoardSeen& seen, const core::CameraModel& camera, const Board& board,
                              const core::RigidTransform& pose) {
  std::vector<double> errors;
  for (const BoardCorner& corner : seen.corners) {
    const core::Pixel truth = *camera.project(pose.apply(board.corner(corner.id)));
    errors.push_back(std::hypot(corner.position.x - truth.x, corner.position.y - truth.y));
  }
  return errors;
}

double largest(const std::vector<double>& values) {
  return values.empty() ? NAN : *std::max_element(values.begin(), values.end());
}

}  // namespace

TEST_CASE("corners of boards are found to a few hundredths of a pixel and called by their names") {
  const core::CameraModel camera = test::distorted_rig(1, 900, 700)[0];
  for (const Board& board : {kChessboard, kCharuco}) {
    for (const CornerMethod method : {CornerMethod::kClassic, CornerMethod::kSectors, CornerMethod::kEither}) {
      if (board.kind == BoardKind::kCharuco && method != CornerMethod::kClassic) continue;
      std::vector<double> errors;
      for (int instant = 0; instant < 6; ++instant) {
        // Every other one upside down.
        core::RigidTransform pose = test::stage_from_board(board, 3, instant, 0.06);
        if (instant % 2 == 1) {
          const core::Vec3 middle{board.columns * board.square_m / 2, board.rows * board.square_m / 2, 0};
          const core::Mat3 turn = core::rotation_about({0, 0, 1}, std::acos(-1.0));
          const core::Vec3 at = pose.apply(middle);
          pose.rotation = pose.rotation * turn;
          pose.translation = at - pose.rotation * middle;
        }
        const BoardSeen seen = find_board(test::picture_of(camera, board, pose, std::uint64_t(instant)), board, method);
        INFO("method " << int(method) << ", instant " << instant << ": " << seen.reason);
        REQUIRE(int(seen.corners.size()) >= (board.kind == BoardKind::kCharuco ? 40 : board.corner_count()));
        for (const double error : errors_px(seen, camera, board, pose)) errors.push_back(error);
      }
      std::sort(errors.begin(), errors.end());
      INFO("median " << errors[errors.size() / 2] << ", 99 % " << errors[errors.size() * 99 / 100] << " px");
      std::cout << "method " << int(method) << ": median " << errors[errors.size() / 2] << ", 99 % "
                << errors[errors.size() * 99 / 100] << " px\n";
      CHECK(errors[errors.size() / 2] < 0.06);
      CHECK(errors[errors.size() * 99 / 100] < 0.25);
    }
  }
}

TEST_CASE("half a ChArUco board is enough, half a chessboard is none") {
  const core::CameraModel camera = test::distorted_rig(1, 900, 700)[0];
  for (const Board& board : {kChessboard, kCharuco}) {
    core::RigidTransform pose = test::stage_from_board(board, 3, 0, 0);
    pose.translation.x += 0.3;
    const BoardSeen seen = find_board(test::picture_of(camera, board, pose, 1), board);
    INFO(seen.reason);
    if (board.kind == BoardKind::kChessboard) {
      CHECK(seen.corners.empty());
      CHECK(seen.reason.find("as a whole") != std::string::npos);
    } else {
      CHECK(seen.corners.size() >= 12);
      CHECK(int(seen.corners.size()) < board.corner_count());
      CHECK(largest(errors_px(seen, camera, board, pose)) < 0.3);
    }
  }
}

TEST_CASE("a mirrored ChArUco board is said to be mirrored; a mirrored chessboard never gives a mirrored pose") {
  const core::CameraModel camera = test::distorted_rig(1, 900, 700)[0];
  const core::RigidTransform pose = test::stage_from_board(kCharuco, 3, 0, 0.02);
  const BoardSeen charuco = find_board(mirrored(test::picture_of(camera, kCharuco, pose, 1)), kCharuco);
  CHECK(charuco.corners.empty());
  CHECK(charuco.reason.find("mirrored") != std::string::npos);

  const BoardSeen plain = find_board(mirrored(test::picture_of(camera, kChessboard, pose, 1)), kChessboard);
  REQUIRE(plain.corners.size() == std::size_t(kChessboard.corner_count()));
  const auto at = [&](int id) { return plain.corners[std::size_t(id)].position; };
  const core::Pixel first = at(0), right = at(1), below = at(kChessboard.columns - 1);
  CHECK((right.x - first.x) * (below.y - first.y) - (right.y - first.y) * (below.x - first.x) > 0);
}

TEST_CASE("pictures without the board, of another board, too small or too blurred have no corners but a reason") {
  const core::CameraModel camera = test::distorted_rig(1, 600, 480)[0];
  const core::RigidTransform pose = test::stage_from_board(kCharuco, 3, 0, 0);
  Board markers = kCharuco, squares = kChessboard;
  markers.dictionary = "6x6_250";
  squares.columns = 12;
  const core::Image black(480, 600, 1);
  for (const Board& board : {kChessboard, kCharuco}) {
    for (const core::Image& picture :
         {black, test::picture_of(camera, board.kind == BoardKind::kCharuco ? markers : squares, pose, 1),
          test::picture_of(camera, board, pose, 1, 14), core::Image(8, 8, 1)}) {
      const BoardSeen seen = find_board(picture, board);
      CHECK(seen.corners.empty());
      CHECK(!seen.reason.empty());
    }
  }
  // Fewer squares are looked for than there are.
  Board smaller = kChessboard;
  smaller.columns = 8;
  CHECK(find_board(test::picture_of(camera, kChessboard, pose, 1), smaller).corners.empty());
}

TEST_CASE("a board in a picture of 4096 x 4096 pixels is found in seconds") {
  core::CameraModel camera = test::distorted_rig(1, 4096, 4096)[0];
  for (const Board& board : {kChessboard, kCharuco}) {
    const core::RigidTransform pose = test::stage_from_board(board, 3, 1, 0.02);
    const core::Image picture = test::picture_of(camera, board, pose, 1, 1.2);
    const core::Stopwatch watch;
    const BoardSeen seen = find_board(picture, board);
    std::cout << "found in " << watch.seconds() << " s\n";
    INFO(seen.reason);
    CHECK(int(seen.corners.size()) == board.corner_count());
    CHECK(largest(errors_px(seen, camera, board, pose)) < 0.5);
  }
}

TEST_CASE("a printed board looks as it is described") {
  for (const Board& board : {kChessboard, kCharuco}) {
    const core::Image picture = board_picture(board, 60, 30);
    REQUIRE(picture.width() == 10 * 60 + 60);
    REQUIRE(picture.height() == 7 * 60 + 60);
    CHECK(picture(29, 29) == 1);  // margin
    CHECK(picture(31, 31) == 0);  // top left square
    CHECK(picture(35, 95) == 1);  // its neighbour's rim
    const BoardSeen seen = find_board(picture, board);
    INFO(seen.reason);
    REQUIRE(int(seen.corners.size()) == board.corner_count());
    for (const BoardCorner& corner : seen.corners) {
      const core::Vec3 p = board.corner(corner.id) / board.square_m * 60;
      CHECK(corner.position.x == Approx(p.x + 29.5).margin(0.35));
      CHECK(corner.position.y == Approx(p.y + 29.5).margin(0.35));
    }
  }
}

TEST_CASE("boards that cannot be measured with are refused by name") {
  const auto refused = [](Board board, const std::string& what) {
    CHECK_THROWS_AS(require_usable(board), core::BadInput);
    try {
      require_usable(board);
    } catch (const core::BadInput& error) {
      CHECK(std::string(error.what()).find(what) != std::string::npos);
    }
  };
  refused({.kind = BoardKind::kChessboard, .columns = 8, .rows = 8}, "turned by a quarter");
  refused({.columns = 2}, "3 to 100");
  refused({.square_m = 0}, "side");
  refused({.square_m = NAN}, "side");
  refused({.square_m = 0.02, .marker_m = 0.02}, "markers");
  refused({.dictionary = "4x4_25"}, "did you mean");
  refused({.columns = 30, .rows = 30, .dictionary = "4x4_50"}, "take a larger one");
}

}  // namespace lightstage::calib
