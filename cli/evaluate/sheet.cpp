#include "cli/evaluate/sheet.h"

#include <algorithm>

#include "cli/format.h"
#include "cli/report/contact_sheet.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "model/evaluation.h"

namespace lightstage::cli {

namespace {

// Which truths to show: some of the brighter half, in which there is something to see, from the brightest on.
std::vector<std::size_t> shown_rows(std::span<const core::Image> truth, std::size_t rows) {
  std::vector<std::pair<double, std::size_t>> by_brightness;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    double sum = 0;
    for (const float value : truth[i].values()) sum += double(value);
    by_brightness.emplace_back(-sum, i);
  }
  std::sort(by_brightness.begin(), by_brightness.end());
  std::vector<std::size_t> shown;
  const std::size_t brighter_half = (truth.size() + 1) / 2;
  for (std::size_t r = 0; r < std::min(rows, brighter_half); ++r) {
    shown.push_back(by_brightness[r * brighter_half / std::min(rows, brighter_half)].second);
  }
  return shown;
}

}  // namespace

void write_sheet(const std::filesystem::path& path, const core::OlatScan& scan,
                 const std::vector<MethodChoice>& choices, std::span<const core::Direction> directions,
                 std::span<const core::Image> truth, bool linear) {
  constexpr std::size_t kRows = 4;
  constexpr double kDifferenceGain = 4;
  std::vector<std::unique_ptr<model::LightInterpolator>> interpolators;
  for (const MethodChoice& choice : choices) {
    interpolators.push_back(model::make_interpolator(choice.method, scan, choice.options));
  }
  std::vector<std::vector<SheetCell>> rows;
  for (const std::size_t i : shown_rows(truth, kRows)) {
    core::throw_if_interrupted();
    const core::Image shown_truth = core::to_rgb(model::judged(truth[i], scan.exposure(), linear));
    std::vector<SheetCell> row{{shown_truth, "truth " + fixed(directions[i].longitude_degrees(), 0) + ", " +
                                                 fixed(directions[i].latitude_degrees(), 0) + " deg"}};
    std::vector<SheetCell> differences;
    for (const auto& interpolator : interpolators) {
      const core::Image shown =
          core::to_rgb(model::judged(interpolator->render(directions[i]), scan.exposure(), linear));
      differences.push_back({difference_picture(shown, shown_truth, kDifferenceGain),
                             std::string(interpolator->name()) + " error x" + fixed(kDifferenceGain, 0)});
      row.push_back({shown, std::string(interpolator->name())});
    }
    row.insert(row.end(), differences.begin(), differences.end());
    rows.push_back(std::move(row));
  }
  core::write_image(path, contact_sheet(rows), {.encoding = core::Encoding::kLinear});
}

}  // namespace lightstage::cli
