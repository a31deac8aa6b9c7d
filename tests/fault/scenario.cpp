#include "fault/scenario.h"

#include <algorithm>
#include <chrono>
#include <fstream>

#include "core/direction.h"
#include "core/image.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "db/store.h"
#include "fault/program.h"

namespace lightstage::fault {

namespace fs = std::filesystem;

namespace {

constexpr int kLights = 24;

void must(const Arguments& arguments) {
  const Outcome outcome = run_program(arguments, {});
  if (outcome.status != 0) throw std::runtime_error("preparing failed: " + outcome.err);
}

Arguments in_store(const fs::path& folder, Arguments arguments) {
  arguments.insert(arguments.end(), {"--store", (folder / "store").string(), "--threads", "2"});
  return arguments;
}

bool there_is_a_store(const fs::path& folder) {
  std::error_code error;
  const auto size = fs::file_size(folder / "store/store.sqlite", error);
  return !error && size > 0;
}

// Lights that were lit just before rise a little sooner (sim/devices/led_bank.h): they are given 40 times their rise time, so that a frame does not
// depend on whether the pass was resumed before it.
Arguments capture(const fs::path& folder, bool moving) {
  Arguments arguments{"capture",  "--sim", "--procedural", "3",    "--stage",          (folder / "stage.toml").string(),
                      "--size",   "48",    "--name",       "head", "--no-light-check", "--no-noise",
                      "--settle", "12"};
  if (!moving) arguments.push_back("--no-motion");
  return in_store(folder, arguments);
}

void prepare_stage(const fs::path& folder) {
  must({"stage", "--lights", std::to_string(kLights), "--out", (folder / "stage.toml").string()});
  must(in_store(folder, {"init"}));
}

void prepare_captured(const fs::path& folder, bool moving) {
  prepare_stage(folder);
  must(capture(folder, moving));
}

// A matte ball under lights all round.
void write_pictures(const fs::path& folder) {
  fs::create_directories(folder);
  std::vector<core::LpEntry> entries;
  for (int i = 0; i < kLights; ++i) {
    const double longitude = 2.4 * i, z = 0.2 + 0.75 * i / kLights, r = std::sqrt(1 - z * z);
    const core::Direction light = core::Direction::from_vector({r * std::cos(longitude), r * std::sin(longitude), z});
    core::Image picture(32, 32, 3);
    for (int y = 0; y < 32; ++y)
      for (int x = 0; x < 32; ++x) {
        const double nx = (x - 15.5) / 16, ny = (15.5 - y) / 16, nz = std::sqrt(std::max(0.0, 1 - nx * nx - ny * ny));
        const double lit = std::max(0.0, nx * light.x() + ny * light.y() + nz * light.z()) * (nz > 0);
        for (int c = 0; c < 3; ++c) picture(y, x, c) = float(lit * (0.5 + 0.1 * c));
      }
    entries.push_back({"p" + std::to_string(i) + ".exr", light});
    core::write_image(folder / entries.back().name, picture);
  }
  core::write_lp(folder / "a.lp", entries);
}

bool has_product(const fs::path& folder, std::string_view kind) {
  return !db::Store::open(folder / "store").products(kind).empty();
}

void flip_a_bit(const fs::path& file) {
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  stream.seekg(0, std::ios::end);
  const auto middle = stream.tellg() / 2;
  stream.seekg(middle);
  const char byte = char(stream.get() ^ 8);
  stream.seekp(middle);
  stream.put(byte);
}

Scenario init() {
  const auto command = [](const fs::path& folder) { return in_store(folder, {"init"}); };
  return {"init", [](const fs::path&) {}, command,
          [command](const fs::path& folder) { return there_is_a_store(folder) ? Arguments{} : command(folder); }};
}

Scenario capture_pass() {
  return {"capture", prepare_stage, [](const fs::path& folder) { return capture(folder, false); },
          [](const fs::path& folder) {
            if (!db::Store::open(folder / "store").find_scan("head")) return capture(folder, false);
            return in_store(folder, {"capture", "--resume", "--name", "head"});
          }};
}

Scenario import_pictures() {
  const auto command = [](const fs::path& folder) {
    return in_store(folder, {"import", "lp", (folder / "pictures/a.lp").string(), "--name", "ball"});
  };
  return {"import",
          [](const fs::path& folder) {
            must(in_store(folder, {"init"}));
            write_pictures(folder / "pictures");
          },
          command,
          [command](const fs::path& folder) {
            return db::Store::open(folder / "store").find_scan("ball") ? Arguments{} : command(folder);
          }};
}

Scenario align_pass() {
  const auto command = [](const fs::path& folder) { return in_store(folder, {"align", "head", "--flow", "dis-fast"}); };
  return {
      "align", [](const fs::path& folder) { prepare_captured(folder, true); }, command,
      [command](const fs::path& folder) { return has_product(folder, "alignment") ? Arguments{} : command(folder); }};
}

Scenario superres() {
  const auto command = [](const fs::path& folder) {
    return in_store(folder, {"superres", "head", "--lights", "20", "--method", "linear", "--out", "dense"});
  };
  return {"superres", [](const fs::path& folder) { prepare_captured(folder, false); }, command, command};
}

Scenario backup() {
  const auto command = [](const fs::path& folder) {
    return in_store(folder, {"store", "backup", (folder / "backup").string()});
  };
  return {"backup", [](const fs::path& folder) { prepare_captured(folder, false); }, command, command};
}

Scenario restore() {
  const auto command = [](const fs::path& folder) {
    return in_store(folder, {"store", "restore", (folder / "backup").string()});
  };
  return {"restore",
          [](const fs::path& folder) {
            prepare_captured(folder, false);
            must(in_store(folder, {"store", "backup", (folder / "backup").string()}));
            fs::remove_all(folder / "store");
          },
          command,
          [command](const fs::path& folder) { return there_is_a_store(folder) ? Arguments{} : command(folder); }};
}

Scenario repair() {
  const auto command = [](const fs::path& folder) {
    return in_store(folder, {"store", "repair", "--from", (folder / "backup").string()});
  };
  return {"repair",
          [command](const fs::path& folder) {
            prepare_captured(folder, false);
            must(in_store(folder, {"store", "backup", (folder / "backup").string()}));
            const db::Store store = db::Store::open(folder / "store");
            for (const db::Frame& frame : store.frames(store.scan("head").id)) {
              if (frame.step_index % 2 == 0) flip_a_bit(store.object_path(frame.object));
              if (frame.step_index % 5 == 0) fs::remove(store.object_path(frame.object));
            }
          },
          command, command};
}

Scenario garbage() {
  const auto command = [](const fs::path& folder) { return in_store(folder, {"store", "gc", "--older-than", "0"}); };
  return {"gc",
          [](const fs::path& folder) {
            prepare_captured(folder, false);
            db::Store store = db::Store::open(folder / "store");
            for (int i = 0; i < 20; ++i) store.put_object(core::Image(5, 5 + i, 1));
          },
          command, command};
}

}  // namespace

const std::vector<Scenario>& scenarios() {
  static const std::vector<Scenario> all{init(),   capture_pass(), import_pictures(), align_pass(), superres(),
                                         backup(), restore(),      repair(),          garbage()};
  return all;
}

std::vector<std::string> contents(const fs::path& store_folder) {
  std::vector<std::string> lines;
  std::error_code error;
  if (!fs::exists(store_folder / "store.sqlite", error)) return lines;
  const db::Store store = db::Store::open(store_folder);
  for (const db::Scan& scan : store.scans()) {
    for (const db::Frame& frame : store.frames(scan.id)) {
      lines.push_back(scan.name + "/" + frame.camera + "/" + std::to_string(frame.step_index) + " " +
                      frame.object.hex());
    }
    for (const char* kind : {"mask", "alignment", "virtual_stage", "light_pack"}) {
      const auto product = store.newest_product(kind, scan.id);
      if (!product) continue;
      for (const db::ProductImage& image : product->images) {
        lines.push_back(scan.name + "/" + kind + "/" + image.role + "/" + std::to_string(image.index) + " " +
                        image.object.hex());
      }
    }
  }
  std::sort(lines.begin(), lines.end());
  return lines;
}

}  // namespace lightstage::fault
