// Where the frames of a pass go.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "capture/devices.h"
#include "db/store.h"

namespace lightstage::capture {

struct KeptFrame {
  const db::Step* step = nullptr;
  std::string camera;
  int attempt = 1;
  CameraFrame frame;
  std::optional<db::UnsyncedFrame> unsynced;  // between writing and storing
};

// Stores frames on threads of its own, so that lights and cameras need not wait for processor and disk: some write pictures, each its own; one makes durable
// what they have written, all that there is at a time, because the disk takes little longer for many than for one. Frames are stored in the order in which they come. What a pass reports as stored
// has been stored: finish() says so.
class FrameKeeper {
 public:
  struct Target {
    std::function<void(KeptFrame&)> write;               // called on several threads at once
    std::function<void(std::vector<KeptFrame>&)> store;  // on one thread, for frames that are written
  };

  // Writes on twice core::thread_count() threads, since they wait for the disk half of the time; at most 8.
  explicit FrameKeeper(Target target);
  // Waits until all is stored; errors are lost (call finish() first).
  ~FrameKeeper();
  FrameKeeper(const FrameKeeper&) = delete;
  FrameKeeper& operator=(const FrameKeeper&) = delete;

  // Waits while half a gigabyte of frames is not stored yet. Throws what the target threw on an earlier frame: that one
  // and those after it are not stored (of those stored together with it none).
  void keep(KeptFrame frame);
  // Whether keep() would take so many bytes of pictures without waiting.
  bool has_room(std::size_t bytes);
  // Returns when everything is stored; throws as keep().
  void finish();

 private:
  struct Entry {
    KeptFrame frame;
    std::size_t bytes = 0;
    enum { kWaiting, kWriting, kWritten } state = kWaiting;
    std::exception_ptr failure;  // of the writing
  };

  void write_frames();
  void store_frames();
  std::vector<KeptFrame> take_written(std::size_t& bytes);
  void rethrow_if_failed(std::unique_lock<std::mutex>& lock);

  Target target_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Entry> queue_;  // in the order of coming; those that are being stored are no longer in it
  std::size_t bytes_ = 0;    // of all frames that are not stored yet
  bool storing_ = false, closing_ = false;
  std::exception_ptr failure_;
  std::vector<std::thread> threads_;
};

}  // namespace lightstage::capture
