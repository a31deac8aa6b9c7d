// Training a network on captured scans (Sun et al. 2020, section 4.4), or on simulated ones.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/olat_scan.h"
#include "model/checkpoint.h"

namespace lightstage::model {

// Which k lights make the picture of a captured light in training.
enum class ActiveSetChoice {
  kRandom,  // any k of the m nearest, so that a network meets lights at many distances (Sun et al. 2020, section 4.4)
  kNaive,   // the k nearest; the publication's ablation
  // The k nearest of a stage thinned at random to 1.4 to 2 times the spacing, with the guide and the spacing of that stage: relative to it the
  // captured light stands between the others as users' queries do, not a whole spacing away.
  kThinned,
};

struct TrainOptions {
  NetworkConfig config;
  std::uint64_t seed = 1;
  int crop = 96;        // pixels; smaller images are taken whole
  int candidates = 16;  // m of ActiveSetChoice::kRandom
  // On captured scans; by default random for superres, as published, and thinned for blend and xu_adaptive. Simulated views take the nearest. xu and meka,
  // which have no active set, take kNaive only.
  std::optional<ActiveSetChoice> active_set;
  // From coarse pictures to fine ones (model/net/progressive.h). By default on for superres that starts untrained, else off; the others have no
  // coarse pictures.
  std::optional<bool> progressive;
  // Of Adam; by default 1e-3, as published for superres, and 2e-3 for blend, a tenth of that with `start_from`. Decays to 1/100 along a cosine over the
  // budget, in progressive training over the last stage, for xu over what is left when its lights are chosen.
  std::optional<double> learning_rate;
  // Of ln s, as a factor of the rate of all else; at 1 it unsettles training, 0 freezes s.
  double sharpness_rate = 0.1;
  std::optional<double> minutes;      // stop after so long (wall clock, everything included), or
  std::optional<std::int64_t> steps;  // after so many steps; at least one of the two
  int validate_every = 200;           // steps
  // Stop after so many validations in a row without a new best one (0: never); in progressive training those count in which full-size pictures are
  // trained.
  int early_stop = 0;
  int held_out_every =
      0;  // the scans given lack every n-th light of the stage, kept for evaluation; recorded in the checkpoint (0: none)
  std::optional<std::filesystem::path> resume;  // a checkpoint written by an earlier run with the same settings
  std::optional<std::filesystem::path>
      start_from;  // a checkpoint of the same configuration, to be trained on with other data
};

struct LossPoint {
  std::int64_t step = 0;
  double seconds = 0;
  // Masked L1: the mean since the last point, of coarse pictures where `level` says so,
  double train = 0;
  // and of full-size pictures of held-out lights, from their nearest neighbours, the same draws every time.
  double validation = 0;
  double level = 0;  // pictures of 1 / 2^level of the size were trained: 0 is full size, 2.3 is 3 fading into 2
};

struct TrainReport {
  std::int64_t steps = 0;
  double seconds = 0;
  std::size_t parameters = 0;
  std::vector<LossPoint> curve;
  double best_validation = 0;   // of the checkpoint written
  double guide_validation = 0;  // the same error of thin-plate interpolation, the method `rbf`
  bool stopped_early = false;   // by TrainOptions::early_stop
  // The loss, its gradient or the validation error was not finite; the checkpoint is the last good one.
  bool stopped_by_nan = false;
};

// What a simulated stage captures of a subject, noise and all, and the truth where none of its lights stands, which a real stage cannot know:
// queries stand where users' do, between lights, and not in a light's own place. Truth is in the units and pose of the scan's images.
struct TruthView {
  core::OlatScan scan;
  std::vector<core::Direction> queries;
  std::vector<core::Image> truth;  // one a query
};

// `make(i)`, for i below count, gives the same view each time it is asked; it is asked when a view is first needed, so a run begins at once. The first
// few views serve validation.
struct SimulatedViews {
  std::size_t count = 0;
  std::string description;  // JSON of all that decides what is made; recorded as provenance
  std::function<TruthView(std::size_t index)> make;
};

// xu chooses its lights in the first third of the budget, on pictures a quarter of the size (model/net/light_selection.h); then, or from the start with
// `start_from`, they stand firm, and the rest of the network is trained at full size.
//
// Query and truth are one captured light; its active set never holds it, nor any light in its place, as no capture stands where a user
// will ask. About one light in sixteen is never a truth, for validation. Random crops inside the mask's bounding box; the loss is masked
// L1, for all but superres plus 4 times the masked squared error (pictures are judged by its root), of display-encoded values up to 2; Adam
// (0.9, 0.999, 1e-7). Writes the best checkpoint by validation to `out` (atomically; first the untrained one, then at every
// validation that improves); at every validation the current one to last_checkpoint_path(out), the optimiser's state to OUT.state for
// resuming, and the curve to OUT.csv and OUT.png. A resumed run counts the steps and the time of the runs before it into its budget. Bit-equal for a seed and step budget on one thread, resumed or
// not. Whatever is thrown after the first step, the state is written first. Memory: 12 bytes a light and pixel of the mask's bounding box. Throws
// UsageError for options out of range, for scans with fewer lights than neighbours + 1, and where `out` names no file, or it or its last
// checkpoint exists and it is not the run to be resumed; BadInput for a run that cannot be resumed (a checkpoint or state that is missing, damaged or of other
// settings or pictures) and a network that makes no finite pictures of the scans; Interrupted on Ctrl-C.
TrainReport train(std::span<const core::OlatScan> scans, const TrainOptions& options, const std::filesystem::path& out);

// "x.last.safetensors" for "x.safetensors": the weights with which a run ended or goes on, where `out` has the best.
std::filesystem::path last_checkpoint_path(const std::filesystem::path& out);

// The same on simulated views; active sets are the nearest lights, and half the draws are mirrored. Memory: 6 bytes a pixel, light and query, and
// another 6 a query, for each view made so far.
TrainReport train(const SimulatedViews& views, const TrainOptions& options, const std::filesystem::path& out);

}  // namespace lightstage::model
