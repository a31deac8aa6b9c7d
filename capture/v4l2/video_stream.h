// Buffers that a driver fills with pictures, one after another.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "capture/v4l2/video_device.h"
#include "core/clock.h"

namespace lightstage::capture {

// Where the buffers lie: the driver's memory mapped into the program, or the program's own lent to the driver.
enum class BufferMemory { kMmap, kUserPointer };

class StreamBuffers;

// Streams from construction to destruction. The device must outlive it.
class VideoStream {
 public:
  // Throws VideoError. `picture_bytes` is what the driver said a picture needs.
  VideoStream(const VideoDevice& device, BufferMemory memory, std::size_t picture_bytes);
  ~VideoStream();
  VideoStream(const VideoStream&) = delete;
  VideoStream& operator=(const VideoStream&) = delete;

  // The oldest filled buffer is shown to `use` and then handed back to the driver to be filled again: what is needed of its
  // bytes must be copied in there. Waits for one until `deadline`; false when none came. Throws VideoError when the device
  // has failed.
  using Use = std::function<void(const v4l2_buffer& about, std::span<const std::byte> bytes)>;
  bool fetch(core::Nanoseconds deadline, const core::Clock& clock, const Use& use);

 private:
  void stop();
  bool dequeue(v4l2_buffer& buffer, short events);

  const VideoDevice& device_;
  std::unique_ptr<StreamBuffers> buffers_;
};

// In mapped memory, or, where the driver does not export that, in the program's own.
std::unique_ptr<VideoStream> start_stream(const VideoDevice& device, std::size_t picture_bytes);

}  // namespace lightstage::capture
