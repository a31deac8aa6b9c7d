// TOML files that room calib checks: boards and balls.
#include "cli/jobs/ball_pictures.h"
#include "cli/jobs/board_file.h"
#include "core/image_file.h"
#include "fuzz/target.h"

namespace lightstage::fuzz {

namespace {

namespace fs = std::filesystem;

const Registration kBoard({"board", [](Bytes bytes) { cli::read_board(write(scratch() / "board.toml", bytes)); }});

const Registration kBalls({"balls", [](Bytes bytes) {
                             const fs::path folder = scratch() / "balls";
                             static const bool made = [&] {
                               fs::create_directories(folder / "sub");
                               for (const char* name : {"1.png", "2.png", "sub/1.png", "sub/2.png"}) {
                                 core::write_image(folder / name, core::Image(12, 16, 1));
                               }
                               return true;
                             }();
                             static_cast<void>(made);
                             cli::find_balls(folder, write(scratch() / "balls.toml", bytes), false);
                           }});

}  // namespace

}  // namespace lightstage::fuzz
