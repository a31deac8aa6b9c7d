#include "capture/session/frame_keeper.h"

#include <algorithm>

#include "core/parallel.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kMostBytes = std::size_t{512} << 20;
constexpr int kMostWriters = 8;

}  // namespace

FrameKeeper::FrameKeeper(Target target) : target_(std::move(target)) {
  const int writers = std::min(2 * core::thread_count(), kMostWriters);
  for (int i = 0; i < writers; ++i) threads_.emplace_back([this] { write_frames(); });
  threads_.emplace_back([this] { store_frames(); });
}

FrameKeeper::~FrameKeeper() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void FrameKeeper::rethrow_if_failed(std::unique_lock<std::mutex>& lock) {
  if (!failure_) return;
  lock.unlock();
  std::rethrow_exception(failure_);
}

void FrameKeeper::keep(KeptFrame frame) {
  const std::size_t bytes = frame.frame.image.values().size_bytes();
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failure_ || bytes_ == 0 || bytes_ + bytes <= kMostBytes; });
  rethrow_if_failed(lock);
  bytes_ += bytes;
  queue_.push_back({std::move(frame), bytes});
  changed_.notify_all();
}

bool FrameKeeper::has_room(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  return failure_ || bytes_ == 0 || bytes_ + bytes <= kMostBytes;
}

void FrameKeeper::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failure_ || (queue_.empty() && !storing_); });
  rethrow_if_failed(lock);
}

void FrameKeeper::write_frames() {
  std::unique_lock lock(mutex_);
  while (true) {
    const auto waiting = [&] {
      return std::find_if(queue_.begin(), queue_.end(), [](const Entry& e) { return e.state == Entry::kWaiting; });
    };
    changed_.wait(lock, [&] { return closing_ || waiting() != queue_.end(); });
    const auto next = waiting();
    if (next == queue_.end()) return;
    // Stays where it is: a deque moves nothing when its ends change, and entries leave it only when they are written.
    Entry& entry = *next;
    entry.state = Entry::kWriting;
    if (!failure_) {
      lock.unlock();
      std::exception_ptr failure;
      try {
        target_.write(entry.frame);
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      entry.failure = failure;
    }
    entry.state = Entry::kWritten;
    changed_.notify_all();
  }
}

// The frames at the head of the queue that are written, and their bytes.
std::vector<KeptFrame> FrameKeeper::take_written(std::size_t& bytes) {
  std::vector<KeptFrame> written;
  while (!queue_.empty() && queue_.front().state == Entry::kWritten && !queue_.front().failure) {
    bytes += queue_.front().bytes;
    written.push_back(std::move(queue_.front().frame));
    queue_.pop_front();
  }
  return written;
}

void FrameKeeper::store_frames() {
  std::unique_lock lock(mutex_);
  while (true) {
    const auto ready = [&] { return !queue_.empty() && queue_.front().state >= Entry::kWritten; };
    changed_.wait(lock, [&] { return (closing_ && queue_.empty()) || ready(); });
    if (queue_.empty()) return;
    if (!failure_) failure_ = queue_.front().failure;
    if (failure_) {
      bytes_ -= queue_.front().bytes;
      queue_.pop_front();
      changed_.notify_all();
      continue;
    }
    std::size_t bytes = 0;
    std::vector<KeptFrame> frames = take_written(bytes);
    storing_ = true;
    lock.unlock();
    std::exception_ptr failure;
    try {
      target_.store(frames);
    } catch (...) {
      failure = std::current_exception();
    }
    frames.clear();
    lock.lock();
    failure_ = failure;
    storing_ = false;
    bytes_ -= bytes;
    changed_.notify_all();
  }
}

}  // namespace lightstage::capture
