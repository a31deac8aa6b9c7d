#include "capture/session/frame_matcher.h"

#include <algorithm>

namespace lightstage::capture {

namespace {
constexpr std::size_t kLineLength = 15;  // frames that a line is laid through
constexpr std::size_t kLineLeast = 6;
constexpr int kFramesOfALag = 5;  // in a row off the line: it is not a frame that was late, all are
}  // namespace

void TriggeredMatcher::expect(int step, core::Nanoseconds first_start, core::Nanoseconds last_start) {
  windows_.push_back({step, first_start, std::max(first_start, last_start)});
}

std::size_t TriggeredMatcher::outstanding() const {
  return windows_.size() > frames_.size() ? windows_.size() - frames_.size() : 0;
}

std::optional<std::size_t> TriggeredMatcher::only_window(const CameraFrame& frame) const {
  const core::Nanoseconds earliest = frame.timestamp - latency_.most, latest = frame.timestamp - latency_.least;
  std::optional<std::size_t> only;
  for (std::size_t i = 0; i < windows_.size(); ++i) {
    if (windows_[i].last_start < earliest || windows_[i].first_start > latest) continue;
    if (only) return std::nullopt;
    only = i;
  }
  return only;
}

TriggeredMatcher::Assignment TriggeredMatcher::assign() const {
  Assignment assignment;
  std::vector<Claim>& claims = assignment.claims;
  std::optional<std::int64_t> last_number;
  std::vector<int> claimed(windows_.size(), 0);
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const bool repeated = last_number && frames_[i].sequence_number <= *last_number;
    if (!repeated && !frames_[i].damaged) last_number = frames_[i].sequence_number;
    const std::optional<std::size_t> window = only_window(frames_[i]);
    if (repeated || !window) continue;
    ++claimed[*window];
    claims.push_back({*window, i, !frames_[i].damaged});
  }
  // Two frames for one exposure: one of them is another exposure's, and nobody knows which.
  for (Claim& claim : claims) claim.certain = claim.certain && claimed[claim.window] == 1;
  // Damaged frames' numbers may be damaged too.
  std::optional<std::int64_t> anchor;  // number of the exposure before the first window
  if (last_number_) anchor = *last_number_;
  for (std::size_t i = 0; i < claims.size(); ++i) {
    const CameraFrame& frame = frames_[claims[i].frame];
    if (frame.damaged) continue;
    const std::int64_t before_first = frame.sequence_number - static_cast<std::int64_t>(claims[i].window) - 1;
    if (!anchor) anchor = before_first;
    if (!assignment.lost_count && before_first != *anchor) {
      assignment.lost_count = true;
      // More exposures than were asked for: which of the two is not the asked one cannot be told.
      if (before_first > *anchor && i > 0) claims[i - 1].certain = false;
    }
    if (assignment.lost_count) claims[i].certain = false;
  }
  return assignment;
}

std::vector<MatchedFrame> TriggeredMatcher::close() {
  std::vector<MatchedFrame> matched;
  for (const Claim& claim : assign().claims) {
    if (claim.certain) matched.push_back({windows_[claim.window].step, std::move(frames_[claim.frame])});
  }
  std::sort(matched.begin(), matched.end(), [](const auto& a, const auto& b) { return a.step < b.step; });
  return matched;
}

std::optional<core::Nanoseconds> StampLine::offset() const {
  if (offsets_.size() < kLineLeast) return std::nullopt;
  return *std::min_element(offsets_.begin(), offsets_.end());
}

std::optional<core::Nanoseconds> StampLine::note(const CameraFrame& frame) {
  const core::Nanoseconds value = frame.timestamp - frame.sequence_number * period_;
  offsets_.push_back(value);
  if (offsets_.size() > kLineLength) offsets_.pop_front();
  const std::optional<core::Nanoseconds> line = offset();
  if (!line) return std::nullopt;
  return value - *line;
}

std::optional<core::Nanoseconds> StampLine::next_stamp(core::Nanoseconds time) const {
  const std::optional<core::Nanoseconds> start = offset();
  if (!start || period_ <= 0) return std::nullopt;
  const core::Nanoseconds since = time - *start;
  const core::Nanoseconds periods = since >= 0 ? (since + period_ - 1) / period_ : -(-since / period_);
  return *start + periods * period_;
}

void FreeRunMatcher::change(core::Nanoseconds begin, core::Nanoseconds exposure, core::Nanoseconds period,
                            Latency latency, core::Nanoseconds tolerance, core::Nanoseconds arrival) {
  // Exposures at another rate in between shift the phase: then the line of before is of no use.
  if (!kinds_.empty() && kinds_.back().period != period) lines_.erase(exposure);
  kinds_.push_back(
      {begin, exposure, period, {latency.least - tolerance, latency.most + tolerance}, tolerance, arrival});
  lines_.try_emplace(exposure, period);
}

void FreeRunMatcher::lit(int step, core::Nanoseconds first_start, core::Nanoseconds last_start) {
  windows_.push_back({step, first_start, last_start, kinds_.size() - 1});
}

// The kind in whose time the exposure began, whenever within its latency that was; nothing while one kind follows another.
std::optional<std::size_t> FreeRunMatcher::kind_of(const CameraFrame& frame) const {
  for (std::size_t i = kinds_.size(); i-- > 0;) {
    if (frame.timestamp - kinds_[i].latency.most >= kinds_[i].begin) return i;
    if (frame.timestamp - kinds_[i].latency.least >= kinds_[i].begin - 2 * kinds_[i].period) return std::nullopt;
  }
  return std::nullopt;
}

void FreeRunMatcher::add(CameraFrame frame) {
  const bool repeated = last_number_ && frame.sequence_number <= *last_number_;
  if (repeated || frame.damaged) return;
  last_number_ = frame.sequence_number;
  const std::optional<std::size_t> kind = kind_of(frame);
  if (!kind) return;
  const std::optional<core::Nanoseconds> off_line = lines_.at(kinds_[*kind].exposure).note(frame);
  if (!off_line) return;
  if (*off_line <= kinds_[*kind].tolerance) {
    frames_off_line_ = 0;
    if (!lagging_) frames_.push_back({std::move(frame), *kind});
  } else if (++frames_off_line_ >= kFramesOfALag) {
    lagging_ = true;
  }
}

std::optional<core::Nanoseconds> FreeRunMatcher::next_start(core::Nanoseconds time) const {
  const Kind& kind = kinds_.back();
  const std::optional<core::Nanoseconds> stamp = lines_.at(kind.exposure).next_stamp(time + kind.latency.most);
  if (!stamp) return std::nullopt;
  return *stamp + kind.tolerance - kind.latency.least;  // stamps up to the tolerance after the line are taken
}

FreeRunMatcher::Closed FreeRunMatcher::close(core::Nanoseconds now) {
  Closed closed;
  while (!windows_.empty()) {
    const Window& window = windows_.front();
    const Kind& kind = kinds_[window.kind];
    // One more exposure's stamp may be that late, and its frame still be under way.
    if (window.last_start + kind.latency.most + kind.arrival + kind.period > now) break;
    const auto shows = [&](const CertainInLine& f) {
      return f.kind == window.kind && f.frame.timestamp - kind.latency.most >= window.first_start &&
             f.frame.timestamp - kind.latency.least <= window.last_start;
    };
    const auto found = std::find_if(frames_.begin(), frames_.end(), shows);
    if (found != frames_.end()) {
      closed.matched.push_back({window.step, std::move(found->frame)});
      // Frames come in the order of time: those before this one show nothing that is still to be closed.
      frames_.erase(frames_.begin(), found + 1);
    }
    ++closed.steps;
    windows_.pop_front();
  }
  // What has come by now began before any step that is lit from now on.
  if (windows_.empty()) frames_.clear();
  return closed;
}

}  // namespace lightstage::capture
