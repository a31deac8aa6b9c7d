// Lists of pictures, and tables of numbers.
#include <cmath>

#include "cli/jobs/exposed_pictures.h"
#include "cli/report/response_file.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "db/importers.h"
#include "fuzz/target.h"

namespace lightstage::fuzz {

namespace {

namespace fs = std::filesystem;

// A folder with pictures, links that lead out of it and one that stays; a picture beside the folder that nobody may reach.
const fs::path& set_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "set";
    fs::create_directories(made / "sub");
    core::Image picture(2, 2, 1);
    for (const char* name : {"set/a.png", "set/b.png", "set/sub/c.png", "set/001.png", "set/002.png", "secret.png"}) {
      core::write_image(scratch() / name, picture);
    }
    fs::create_symlink("../secret.png", made / "out.png");
    fs::create_directory_symlink("..", made / "up");
    fs::create_symlink("a.png", made / "in.png");
    return made;
  }();
  return folder;
}

void check(const db::PictureSet& set) {
  const fs::path root = fs::canonical(set_folder());
  for (const db::PictureEntry& picture : set.pictures) {
    const fs::path target = fs::canonical(picture.path);
    require(std::mismatch(root.begin(), root.end(), target.begin(), target.end()).first == root.end(),
            "listed pictures lie in the list's folder");
    require(std::abs(norm(picture.direction.vec()) - 1) < 1e-9, "directions have length 1");
    for (const double v : picture.intensity) require(v > 0 && std::isfinite(v), "intensities are positive");
  }
}

const Registration kLp({"lp", [](Bytes bytes) {
                          const fs::path file = write(set_folder() / "a.lp", bytes);
                          core::read_lp(file);
                          check(db::read_lp_set(file));
                        }});

const Registration kCsv({"csv",
                         [](Bytes bytes) { check(db::read_csv_set(write(set_folder() / "lights.csv", bytes))); }});

// The files of a set one after the other, with lines of "=" between.
const Registration kDiligent(
    {"diligent", [](Bytes bytes) {
       std::string_view rest = text_of(bytes);
       for (const char* name : {"light_directions.txt", "filenames.txt", "light_intensities.txt"}) {
         const std::size_t end = std::min(rest.find("=\n"), rest.size());
         write(set_folder() / name, rest.substr(0, end));
         rest.remove_prefix(std::min(rest.size(), end + 2));
       }
       check(db::read_diligent_set(set_folder()));
     }});

const Registration kExposures({"exposures", [](Bytes bytes) {
                                 cli::ExposureFiles files;
                                 files.csv = write(set_folder() / "times.csv", bytes).string();
                                 const auto pictures = cli::read_exposed_pictures(files, core::Encoding::kLinear);
                                 for (const double s : pictures.seconds) {
                                   require(s > 0 && std::isfinite(s), "exposures are positive");
                                 }
                               }});

const Registration kResponse({"response", [](Bytes bytes) {
                                const auto response = cli::read_response(write(scratch() / "response.csv", bytes));
                                for (const auto& curve : response.curve) {
                                  require(curve.size() == 256, "curves have 256 codes");
                                }
                              }});

}  // namespace

}  // namespace lightstage::fuzz
