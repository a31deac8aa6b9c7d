// Which step a frame shows when lights change before frames have arrived: decided so that a frame is never given to a step
// that it does not show. What is not certain is left out, and its step taken again.
//
// The evidence is threefold. Time: a driver stamps a frame some latency after the exposure began; that latency lies within
// bounds that were measured beforehand (latency.h). Sequence numbers: they must advance as the exposures do. And the
// caller's: frames of known brightness (witness.h).
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "capture/devices.h"

namespace lightstage::capture {

// Bounds of a camera's time stamps after the true start of exposure.
struct Latency {
  core::Nanoseconds least = 0, most = 0;
  core::Nanoseconds range() const { return most - least; }
};

struct MatchedFrame {
  int step = 0;
  CameraFrame frame;
};

// Frames of a camera that exposes only when it is triggered.
class TriggeredMatcher {
 public:
  // `last_number` is that of the frame before the first one expected, where one was seen: with no exposure in between.
  explicit TriggeredMatcher(Latency latency, std::optional<std::int64_t> last_number = {})
      : latency_(latency), last_number_(last_number) {}

  // An exposure of this step was asked for and began, if at all, within these times. Steps come in the order of time.
  void expect(int step, core::Nanoseconds first_start, core::Nanoseconds last_start);
  void add(CameraFrame frame) { frames_.push_back(std::move(frame)); }

  // How many frames have come, and how many are still expected, both since the last close.
  std::size_t arrived() const { return frames_.size(); }
  std::size_t outstanding() const;

  // Whether numbers and steps have advanced differently since the first frame: none of those expected after that will be certain.
  bool lost_count() const { return assign().lost_count; }

  // The frames that are certain, in the order of steps, at most one for each; call it once. A frame is certain when the time
  // stamp leaves one step, when no other frame claims that step, and when sequence numbers advanced as the steps did from the
  // first to this one: after a jump of one against the other (a trigger that was not obeyed, a camera that began to lag) nobody
  // knows how far off the rest is. Frames flagged as damaged and repeats of a number never are.
  std::vector<MatchedFrame> close();

 private:
  struct Window {
    int step = 0;
    core::Nanoseconds first_start = 0, last_start = 0;
  };
  // Where a frame seems to belong.
  struct Claim {
    std::size_t window = 0, frame = 0;
    bool certain = true;
  };
  struct Assignment {
    std::vector<Claim> claims;  // in the order of arrival, of frames that seem to belong somewhere
    bool lost_count = false;
  };
  Assignment assign() const;
  std::optional<std::size_t> only_window(const CameraFrame& frame) const;

  Latency latency_;
  std::optional<std::int64_t> last_number_;
  std::vector<Window> windows_;
  std::vector<CameraFrame> frames_;
};

// Where the exposures of a camera that runs free lie in time: its stamps against its sequence numbers. A busy machine stamps
// frames late, never early, so the line goes through the earliest of the newest 15.
class StampLine {
 public:
  explicit StampLine(core::Nanoseconds period) : period_(period) {}
  // Takes note of a frame; how much later than the line its stamp is; nothing while there are fewer than 6 frames.
  std::optional<core::Nanoseconds> note(const CameraFrame& frame);
  // The first stamp not before `time` that the line has; nothing while there are fewer than 6 frames.
  std::optional<core::Nanoseconds> next_stamp(core::Nanoseconds time) const;

 private:
  std::optional<core::Nanoseconds> offset() const;

  core::Nanoseconds period_;
  std::deque<core::Nanoseconds> offsets_;  // of stamp - number * period
};

// Frames of a camera that runs free.
class FreeRunMatcher {
 public:
  // From `begin` on every exposure is of this length, one each `period`, with this latency of its stamps; until the one before
  // has begun for the last time, frames belong to that. Latency is widened by `tolerance` on both sides; a frame whose stamp is
  // later than that after the line of its kind is not certain. Frames come at most `arrival` after their stamp.
  void change(core::Nanoseconds begin, core::Nanoseconds exposure, core::Nanoseconds period, Latency latency,
              core::Nanoseconds tolerance, core::Nanoseconds arrival);

  // Exposures that begin within these times show this step alone. Steps come in the order of time.
  void lit(int step, core::Nanoseconds first_start, core::Nanoseconds last_start);
  void add(CameraFrame frame);

  // The camera's stamps have become later for good, or its count has skipped: nothing is certain any more, measure it anew.
  bool lagging() const { return lagging_; }
  // Whether enough frames of the present kind have come to know where the next exposures lie.
  bool knows_next() const { return lines_.at(kinds_.back().exposure).next_stamp(0).has_value(); }
  // When the next exposure that begins at or after `time`, as far as can be known, will certainly have begun.
  std::optional<core::Nanoseconds> next_start(core::Nanoseconds time) const;

  struct Closed {
    std::size_t steps = 0;              // whose frames must all have come by now
    std::vector<MatchedFrame> matched;  // the frames that are certain, in the order of steps, at most one for each
  };
  // Ends with the steps whose frames have come by `now`, if they ever do, and leaves the others for later. A frame is certain
  // when every start that its latency allows lies within one step's times.
  Closed close(core::Nanoseconds now);

 private:
  struct Kind {
    core::Nanoseconds begin = 0, exposure = 0, period = 0;
    Latency latency;  // widened
    core::Nanoseconds tolerance = 0, arrival = 0;
  };
  struct Window {
    int step = 0;
    core::Nanoseconds first_start = 0, last_start = 0;
    std::size_t kind = 0;
  };
  struct CertainInLine {
    CameraFrame frame;
    std::size_t kind = 0;
  };
  std::optional<std::size_t> kind_of(const CameraFrame& frame) const;

  std::vector<Kind> kinds_;
  std::map<core::Nanoseconds, StampLine> lines_;  // by exposure
  std::optional<std::int64_t> last_number_;
  std::deque<Window> windows_;
  std::deque<CertainInLine> frames_;
  int frames_off_line_ = 0;
  bool lagging_ = false;
};

}  // namespace lightstage::capture
