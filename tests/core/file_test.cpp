#include "core/file.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <fstream>

#include "core/error.h"
#include "core/failure.h"
#include "core/full_disk.h"
#include "support/support.h"

using namespace lightstage;
namespace fs = std::filesystem;

namespace {

std::size_t entries_in(const fs::path& folder) {
  return std::size_t(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

}  // namespace

TEST_CASE("bytes written are bytes read, and nothing else is left behind") {
  const test::TemporaryFolder folder;
  const std::string bytes("a\0b\r\n\xFF", 6);
  core::write_file_atomically(folder / "x", bytes);
  CHECK(core::read_text_file(folder / "x") == bytes);
  core::write_file_atomically(folder / "x", "");
  CHECK(core::read_text_file(folder / "x").empty());
  CHECK(entries_in(folder.path()) == 1);
}

TEST_CASE("what is not a readable small file is refused by name") {
  const test::TemporaryFolder folder;
  core::write_file_atomically(folder / "x", std::string(100, 'x'));
  CHECK(core::read_text_file(folder / "x", 100).size() == 100);
  const auto refusal = [](const fs::path& path, std::size_t limit) {
    return test::failure_of<core::BadInput>([&] { core::read_text_file(path, limit); });
  };
  CHECK(test::says(refusal(folder / "x", 99), (folder / "x").string(), "99 bytes"));
  CHECK(test::says(refusal(folder / "absent", 99), (folder / "absent").string(), "No such file"));
  CHECK(test::says(refusal(folder.path(), 99), folder.path().string(), "not a regular file"));
  // A pipe without a writer must be refused, not waited for.
  REQUIRE(mkfifo((folder / "pipe").c_str(), 0600) == 0);
  CHECK(test::says(refusal(folder / "pipe", 99), "not a regular file"));
}

TEST_CASE("a write that fails leaves the old file and no litter") {
  const test::TemporaryFolder folder;
  core::write_file_atomically(folder / "x", "old");
  {
    const test::FullDisk full(1000);
    const std::string message =
        test::failure_of<core::BadInput>([&] { core::write_file_atomically(folder / "x", std::string(5000, 'n')); });
    CHECK(test::says(message, "cannot write", (folder / "x").string()));
  }
  CHECK(core::read_text_file(folder / "x") == "old");
  CHECK(entries_in(folder.path()) == 1);

  const std::string message =
      test::failure_of<core::BadInput>([&] { core::write_file_atomically(folder / "no/x", "n"); });
  CHECK(test::says(message, "no folder", (folder / "no").string()));
  fs::create_directory(folder / "d");
  CHECK_THROWS_AS(core::write_file_atomically(folder / "d", "n"), core::BadInput);
  CHECK(entries_in(folder.path()) == 2);
}

TEST_CASE("what is not a regular file is never replaced") {
  const test::TemporaryFolder folder;
  REQUIRE(mkfifo((folder / "pipe").c_str(), 0600) == 0);
  const int server = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  (folder / "socket").string().copy(address.sun_path, sizeof address.sun_path - 1);
  REQUIRE(bind(server, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  fs::create_symlink("pipe", folder / "link");
  const auto entries = entries_in(folder.path());
  for (const char* name : {"pipe", "socket", "link"}) {
    const std::string message =
        test::failure_of<core::BadInput>([&] { core::write_file_atomically(folder / name, "n"); });
    CHECK(test::says(message, (folder / name).string(), "not a regular file"));
    // Nor when it comes to stand there while the new bytes are written.
    const std::string late = test::failure_of<core::BadInput>([&] {
      core::replace_file_atomically(folder / "late", [&](const fs::path& temporary) {
        std::ofstream(temporary) << "new";
        fs::create_symlink(folder / name, folder / "late");
      });
    });
    CHECK(test::says(late, (folder / "late").string(), "not a regular file"));
    fs::remove(folder / "late");
  }
  close(server);
  CHECK(fs::is_fifo(fs::symlink_status(folder / "pipe")));
  CHECK(fs::is_socket(fs::symlink_status(folder / "socket")));
  CHECK(fs::is_symlink(fs::symlink_status(folder / "link")));
  CHECK(entries_in(folder.path()) == entries);
  CHECK(test::says(test::failure_of<core::BadInput>([] { core::write_file_atomically("", "n"); }), "''", "name"));
}

TEST_CASE("what a symbolic link names is replaced, and the link stays") {
  const test::TemporaryFolder folder;
  fs::create_directory(folder / "far");
  core::write_file_atomically(folder / "far/file", "old");
  fs::create_symlink("far/file", folder / "one");
  fs::create_symlink("one", folder / "two");
  core::write_file_atomically(folder / "two", "new");
  CHECK(core::read_text_file(folder / "far/file") == "new");
  fs::create_symlink("far/made", folder / "to_nothing");
  core::write_file_atomically(folder / "to_nothing", "made");
  CHECK(core::read_text_file(folder / "far/made") == "made");
  for (const char* link : {"one", "two", "to_nothing"}) CHECK(fs::is_symlink(fs::symlink_status(folder / link)));
  CHECK(entries_in(folder / "far") == 2);

  fs::create_symlink("round", folder / "about");
  fs::create_symlink("about", folder / "round");
  CHECK_THROWS_AS(core::write_file_atomically(folder / "round", "n"), core::BadInput);
  CHECK(fs::is_symlink(fs::symlink_status(folder / "round")));
}

TEST_CASE("a folder for temporary files that is not there is named") {
  {
    const test::EnvironmentVariable variable("TMPDIR", "/nowhere/at/all");
    const std::string message = test::failure_of<core::BadInput>([] { core::temporary_folder(); });
    CHECK(test::says(message, "/nowhere/at/all", "TMPDIR"));
  }
  CHECK(fs::is_directory(core::temporary_folder()));
}

TEST_CASE("replacing a file keeps the old one when the writer throws") {
  const test::TemporaryFolder folder;
  core::write_file_atomically(folder / "x.bin", "old");
  const auto failing = [](const fs::path& temporary) {
    std::ofstream(temporary) << "half";
    throw std::logic_error("writer failed");
  };
  CHECK_THROWS_AS(core::replace_file_atomically(folder / "x.bin", failing), std::logic_error);
  CHECK(core::read_text_file(folder / "x.bin") == "old");
  CHECK(entries_in(folder.path()) == 1);

  fs::path used;
  core::replace_file_atomically(folder / "x.bin", [&](const fs::path& temporary) {
    used = temporary;
    std::ofstream(temporary) << "new";
  });
  CHECK(used.parent_path() == folder.path());
  CHECK(used.extension() == ".bin");
  CHECK(core::read_text_file(folder / "x.bin") == "new");
  CHECK(entries_in(folder.path()) == 1);
}
