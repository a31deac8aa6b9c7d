// Where the frames of a pass go.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "capture/devices.h"
#include "db/store.h"

namespace lightstage::capture {

struct KeptFrame {
  const db::Step* step = nullptr;
  std::string camera;
  int attempt = 1;
  CameraFrame frame;
};

// Stores frames on a thread of its own, in the order in which they come, so that lights and cameras need not wait for the
// disk. What a pass reports as stored has been stored: finish() says so.
class FrameKeeper {
 public:
  using Store = std::function<void(const KeptFrame&)>;

  // `store` is called on the keeper's thread, one frame at a time.
  explicit FrameKeeper(Store store);
  // Waits until all is stored; errors are lost (call finish() first).
  ~FrameKeeper();
  FrameKeeper(const FrameKeeper&) = delete;
  FrameKeeper& operator=(const FrameKeeper&) = delete;

  // Waits while more than half a gigabyte of frames is queued. Throws what `store` threw on an earlier frame: that one
  // and those after it are not stored.
  void keep(KeptFrame frame);
  // Returns when everything is stored; throws as keep().
  void finish();

 private:
  void run();
  void rethrow_if_failed(std::unique_lock<std::mutex>& lock);

  Store store_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<KeptFrame> queue_;
  std::size_t queued_bytes_ = 0;
  bool storing_ = false, closing_ = false;
  std::exception_ptr failure_;
  std::thread thread_;
};

}  // namespace lightstage::capture
