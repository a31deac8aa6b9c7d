#include "capture/preview.h"

#include <algorithm>
#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include "capture/preview/tev_link.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/progress.h"

namespace lightstage::capture {

namespace {

constexpr int kLongestSide = 1024;

// Small, finite, of 1 or 3 channels, 1 where the sensor clips.
core::Image shown(const CameraFrame& frame) {
  const int longest = std::max(frame.image.height(), frame.image.width());
  core::Image image = core::shrink_by_box(frame.image, (longest - 1) / kLongestSide + 1);
  if (image.channels() != 1 && image.channels() != 3) image = core::to_rgb(image);
  const double scale = frame.saturation > 0 ? 1 / frame.saturation : 1;
  for (float& v : image.values()) v = std::isfinite(v) ? static_cast<float>(v * scale) : 0.0f;
  return image;
}

}  // namespace

struct Preview::Impl {
  explicit Impl(const PreviewOptions& the_options) : options(the_options) {
    if (options.every < 1) {
      throw core::UsageError("preview: every " + std::to_string(options.every) + " frames is never; at least 1");
    }
    if (!options.tev_address.empty()) viewer.emplace(options.tev_address);
    if (!options.still.empty()) core::write_image(options.still, core::Image(1, 1, 3));
    thread = std::thread([this] { run(); });
  }

  ~Impl() {
    {
      const std::lock_guard lock(mutex);
      closing = true;
    }
    changed.notify_all();
    thread.join();
  }

  void run() {
    std::unique_lock lock(mutex);
    while (true) {
      changed.wait(lock, [&] { return closing || !waiting.empty(); });
      if (waiting.empty()) return;
      // In turn, so that no camera starves while another's frames keep coming.
      auto in_turn = waiting.upper_bound(last);
      if (in_turn == waiting.end()) in_turn = waiting.begin();
      const auto next = waiting.extract(in_turn);
      last = next.key();
      lock.unlock();
      show_now(last, next.mapped());
      lock.lock();
    }
  }

  // The still first: it does not depend on anybody else.
  void show_now(const std::string& camera, const core::Image& image) {
    if (camera == still_camera) write_still(image);
    if (viewer) viewer->show("lightstage " + camera, image);
  }

  void write_still(const core::Image& image) {
    try {
      core::write_image(options.still, core::to_rgb(image));
    } catch (const core::Error& error) {
      core::warn(std::string("preview: ") + error.what() + "; capture goes on without this still");
      still_camera.reset();
    }
  }

  const PreviewOptions options;
  std::map<std::string, int> frames_seen;  // by the caller of show() alone

  std::mutex mutex;
  std::condition_variable changed;
  std::map<std::string, core::Image> waiting;  // the newest of each camera
  bool closing = false;

  // Of the thread below, but for the choice of still_camera, which is made before its first frame waits.
  std::optional<std::string> still_camera;
  std::optional<TevLink> viewer;
  std::string last;  // camera shown
  std::thread thread;
};

Preview::Preview(const PreviewOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Preview::~Preview() = default;

void Preview::show(const std::string& camera, const CameraFrame& frame) {
  const int seen = impl_->frames_seen[camera]++;
  if (seen % impl_->options.every != 0) return;
  core::Image image = shown(frame);
  {
    const std::lock_guard lock(impl_->mutex);
    if (seen == 0 && impl_->frames_seen.size() == 1 && !impl_->options.still.empty()) impl_->still_camera = camera;
    impl_->waiting.insert_or_assign(camera, std::move(image));
  }
  impl_->changed.notify_all();
}

}  // namespace lightstage::capture
