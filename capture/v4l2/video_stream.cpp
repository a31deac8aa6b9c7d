#include "capture/v4l2/video_stream.h"

#include <poll.h>

#include <algorithm>
#include <array>
#include <cerrno>

namespace lightstage::capture {

namespace {

// Enough that the pictures of some steps can wait while the program stores others.
constexpr std::uint32_t kBufferCount = 8;
// With fewer a driver has none to fill while one is copied.
constexpr std::uint32_t kFewestBuffers = 2;
constexpr std::size_t kPageBytes = 4096;

v4l2_buffer empty_buffer(v4l2_memory memory, std::uint32_t index = 0) {
  v4l2_buffer buffer{};
  buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  buffer.memory = memory;
  buffer.index = index;
  return buffer;
}

// 0, or the errno. The driver answers with the number of buffers it grants.
int request_buffers(const VideoDevice& device, v4l2_memory memory, std::uint32_t& count) {
  v4l2_requestbuffers request{};
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = memory;
  request.count = count;
  const int error = device.try_call(VIDIOC_REQBUFS, request);
  count = request.count;
  return error;
}

}  // namespace

// The memory itself; lets go of it at its end.
class StreamBuffers {
 public:
  StreamBuffers(const VideoDevice& the_device, v4l2_memory the_memory) : device(the_device), memory(the_memory) {}
  virtual ~StreamBuffers() = default;
  virtual void queue(std::uint32_t index) = 0;

  const VideoDevice& device;
  const v4l2_memory memory;
  std::vector<std::span<std::byte>> bytes;

 protected:
  void queue_buffer(v4l2_buffer buffer) const { device.call(VIDIOC_QBUF, buffer, "queue a buffer"); }
};

namespace {

class MappedBuffers : public StreamBuffers {
 public:
  MappedBuffers(const VideoDevice& the_device, std::uint32_t count) : StreamBuffers(the_device, V4L2_MEMORY_MMAP) {
    try {
      for (std::uint32_t i = 0; i < count; ++i) map(i);
    } catch (...) {
      unmap();
      throw;
    }
  }
  ~MappedBuffers() override { unmap(); }

  void queue(std::uint32_t index) override { StreamBuffers::queue_buffer(empty_buffer(memory, index)); }

 private:
  void map(std::uint32_t index) {
    v4l2_buffer buffer = empty_buffer(memory, index);
    device.call(VIDIOC_QUERYBUF, buffer, "ask for a buffer");
    std::byte* address = nullptr;
    if (const int error = device.system().map(device.descriptor(), buffer.length, buffer.m.offset, address)) {
      device.fail("map a buffer", error);
    }
    bytes.emplace_back(address, buffer.length);
  }
  void unmap() {
    for (const std::span<std::byte> mapped : bytes) device.system().unmap(mapped.data(), mapped.size());
  }
};

class OwnBuffers : public StreamBuffers {
 public:
  OwnBuffers(const VideoDevice& the_device, std::uint32_t count, std::size_t picture_bytes)
      : StreamBuffers(the_device, V4L2_MEMORY_USERPTR), pages_(count) {
    const std::size_t pages = (picture_bytes + kPageBytes - 1) / kPageBytes;
    for (std::vector<Page>& buffer : pages_) {
      buffer.resize(pages);
      bytes.emplace_back(buffer.front().data(), pages * kPageBytes);
    }
  }

  void queue(std::uint32_t index) override {
    v4l2_buffer buffer = empty_buffer(memory, index);
    buffer.m.userptr = reinterpret_cast<unsigned long>(bytes[index].data());
    buffer.length = static_cast<__u32>(bytes[index].size());
    StreamBuffers::queue_buffer(buffer);
  }

 private:
  // Drivers want whole pages.
  struct alignas(kPageBytes) Page : std::array<std::byte, kPageBytes> {};
  std::vector<std::vector<Page>> pages_;
};

}  // namespace

VideoStream::VideoStream(const VideoDevice& device, BufferMemory memory, std::size_t picture_bytes) : device_(device) {
  const v4l2_memory kind = memory == BufferMemory::kMmap ? V4L2_MEMORY_MMAP : V4L2_MEMORY_USERPTR;
  std::uint32_t count = kBufferCount;
  if (const int error = request_buffers(device, kind, count)) device.fail("get buffers for streaming", error);
  try {
    if (count < kFewestBuffers) device.fail("get buffers for streaming", ENOMEM);
    if (memory == BufferMemory::kMmap) {
      buffers_ = std::make_unique<MappedBuffers>(device, count);
    } else {
      buffers_ = std::make_unique<OwnBuffers>(device, count, picture_bytes);
    }
    for (std::uint32_t i = 0; i < count; ++i) buffers_->queue(i);
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    device.call(VIDIOC_STREAMON, type, "start streaming");
  } catch (...) {
    stop();
    throw;
  }
}

VideoStream::~VideoStream() {
  stop();
}

// Errors do not matter any more: the device may be gone.
void VideoStream::stop() {
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  device_.try_call(VIDIOC_STREAMOFF, type);
  if (!buffers_) return;
  const v4l2_memory memory = buffers_->memory;
  // Drivers keep buffers that are still mapped.
  buffers_.reset();
  std::uint32_t none = 0;
  request_buffers(device_, memory, none);
}

bool VideoStream::fetch(core::Nanoseconds deadline, const core::Clock& clock, const Use& use) {
  for (;;) {
    short events = 0;
    if (const int error = device_.system().poll(device_.descriptor(), deadline - clock.now(), events)) {
      device_.fail("wait for a frame", error);
    }
    v4l2_buffer buffer = empty_buffer(buffers_->memory);
    if (events != 0 && dequeue(buffer, events)) {
      const std::span<std::byte> bytes = buffers_->bytes[buffer.index];
      use(buffer, bytes.first(std::min<std::size_t>(buffer.bytesused, bytes.size())));
      buffers_->queue(buffer.index);
      return true;
    }
    if (clock.now() >= deadline) return false;
  }
}

bool VideoStream::dequeue(v4l2_buffer& buffer, short events) {
  int error = device_.try_call(VIDIOC_DQBUF, buffer);
  // Nothing to fetch, though there was said to be something: at an error that is the whole of the answer.
  if (error == EAGAIN && (events & (POLLERR | POLLHUP | POLLNVAL))) error = EIO;
  if (error == EAGAIN) return false;
  if (!error && buffer.index >= buffers_->bytes.size()) error = EIO;
  if (error) device_.fail("fetch a frame", error);
  return true;
}

std::unique_ptr<VideoStream> start_stream(const VideoDevice& device, std::size_t picture_bytes) {
  std::uint32_t none = 0;
  const bool no_mmap = request_buffers(device, V4L2_MEMORY_MMAP, none) == EINVAL;
  return std::make_unique<VideoStream>(device, no_mmap ? BufferMemory::kUserPointer : BufferMemory::kMmap,
                                       picture_bytes);
}

}  // namespace lightstage::capture
