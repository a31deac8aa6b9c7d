#include "capture/session/frame_keeper.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kMostQueuedBytes = std::size_t{512} << 20;

std::size_t bytes_of(const KeptFrame& kept) {
  return kept.frame.image.values().size_bytes();
}

}  // namespace

FrameKeeper::FrameKeeper(Store store) : store_(std::move(store)), thread_([this] { run(); }) {}

FrameKeeper::~FrameKeeper() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void FrameKeeper::rethrow_if_failed(std::unique_lock<std::mutex>& lock) {
  if (!failure_) return;
  lock.unlock();
  std::rethrow_exception(failure_);
}

void FrameKeeper::keep(KeptFrame frame) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failure_ || queue_.empty() || queued_bytes_ < kMostQueuedBytes; });
  rethrow_if_failed(lock);
  queued_bytes_ += bytes_of(frame);
  queue_.push_back(std::move(frame));
  changed_.notify_all();
}

void FrameKeeper::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failure_ || (queue_.empty() && !storing_); });
  rethrow_if_failed(lock);
}

void FrameKeeper::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return closing_ || !queue_.empty(); });
    if (queue_.empty()) return;
    KeptFrame next = std::move(queue_.front());
    queue_.pop_front();
    queued_bytes_ -= bytes_of(next);
    storing_ = true;
    lock.unlock();
    try {
      store_(next);
      lock.lock();
    } catch (...) {
      lock.lock();
      failure_ = std::current_exception();
      queue_.clear();
      queued_bytes_ = 0;
    }
    storing_ = false;
    changed_.notify_all();
    if (failure_) return;
  }
}

}  // namespace lightstage::capture
