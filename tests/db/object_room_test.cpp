#include "db/object_room.h"

#include <catch2/catch.hpp>
#include <filesystem>
#include <random>

#include "core/disk_space.h"
#include "core/error.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;

TEST_CASE("no picture takes more of the disk than was reckoned, not even noise") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  std::mt19937 random(5);
  // Sign and mantissa at random: nothing to compress.
  std::uniform_real_distribution<float> value(-60000, 60000);
  for (const core::ImageSize size :
       {core::ImageSize{1, 1, 1}, {1, 1, 4}, {16, 16, 3}, {17, 1000, 3}, {1000, 3, 1}, {300, 400, 3}}) {
    CAPTURE(size.height, size.width, size.channels);
    core::Image image(size);
    for (float& v : image.values()) v = value(random);
    const std::uintmax_t bytes = std::filesystem::file_size(store.object_path(store.put_object(image)));
    CHECK(bytes <= db::most_bytes(size));
    CHECK(db::most_bytes(size) <= 2 * bytes + 16'000);
    CHECK(db::most_bytes(size, 1000) == 1000 * db::most_bytes(size));
  }
  CHECK(db::most_bytes({100, 100, 3}, 0) == 0);
}

TEST_CASE("a disk without room is an error that says how much is needed") {
  const test::TemporaryFolder folder;
  CHECK_NOTHROW(core::require_room(folder.path(), 1000, "this"));
  CHECK_THROWS_AS(core::require_room(folder.path(), std::uintmax_t{1} << 60, "that"), core::StoreError);
  CHECK_THROWS_WITH(core::require_room(folder.path(), ~std::uintmax_t{0}, "that"),
                    Catch::Contains("that needs up to 18446.7 PB and a reserve of 16.8 MB, the disk has "));
  CHECK_NOTHROW(core::require_room(folder / "nowhere", std::uintmax_t{1} << 60, "nobody knows"));
  CHECK(core::bytes_text(0) == "0.0 kB");
  CHECK(core::bytes_text(999'949) == "999.9 kB");
  CHECK(core::bytes_text(999'960) == "1.0 MB");
  CHECK(core::bytes_text(1'234'000'000) == "1.2 GB");
}
