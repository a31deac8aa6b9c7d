// An emulated camera that the kernel's uvcvideo drives. It exposes the scene on a trigger or again and again, and sends what it saw.
#pragma once

#include <deque>
#include <functional>
#include <optional>

#include "hil/rig/scene.h"
#include "hil/rig/usbip_device.h"
#include "hil/rig/uvc_descriptors.h"

namespace lightstage::hil {

// What befalls the frame of one exposure.
struct FrameFault {
  bool drop = false;        // it is never sent
  bool truncate = false;    // half of it is sent
  bool flag_error = false;  // it is sent whole, with the error bit
  bool duplicate = false;   // it is sent twice
  Nanoseconds delay = 0;    // it is sent this much later
};

// A cell of the picture has the value black + mean level x exposure / 10 ms x gain / 16 of full scale, up to full scale: level 1 at
// gain 16 fills the scale in 10 ms. Black is 1/64 of full scale. Bayer pictures show red, green and blue, the others their mean.
// Full scale is from 16 to 235 in YUYV, else all that the format's numbers hold.
//
// After it was plugged in it is set as webcams are, for pictures that please: exposure and white balance are automatic, which
// means 33.3 ms here, and red too bright by 3/10.
class UvcCamera : public UsbipDevice {
 public:
  enum class Strobe { kOn, kOff };
  // An exposure that is over.
  struct Exposure {
    int number = 0;  // from 1
    Nanoseconds start = 0, end = 0;
    Levels levels{};
    FrameFault fault;
  };

  // The serial number is CAM<index>, the port index + 1.
  UvcCamera(int index, const Scene& scene);

  std::function<void(Strobe, Nanoseconds time)> on_strobe;
  std::function<FrameFault(int exposure_number)> fault_of;  // asked when an exposure begins
  std::function<void(const Exposure&)> on_exposure;
  std::function<void(bool on)> on_stream;

  int index() const { return index_; }
  void set_free_running(bool free) { free_running_ = free; }
  bool free_running() const { return free_running_; }
  // Counts exposures from 1 again.
  void restart_count() { exposures_ = 0; }
  // False when the trigger is lost: the camera does not stream, runs free, exposes already, or still sends two frames.
  bool trigger(Nanoseconds time);

  // When something happens next without being asked; advance() to that time makes it happen.
  std::optional<Nanoseconds> next_event() const;
  void advance(Nanoseconds time);

 protected:
  Bytes configuration() const override { return uvc_configuration(); }
  std::optional<Bytes> control_in(const Setup& setup) override;
  bool control_out(const Setup& setup, ByteView data) override;
  bool bulk_out(std::uint8_t, ByteView) override { return false; }
  void bulk_in_waiting(std::uint8_t) override { send(); }
  void endpoint_cleared(std::uint8_t endpoint) override;
  void unplugged() override;

 private:
  // Set by the host; lost with the power.
  struct Settings {
    std::uint8_t format = 1, size = 1;  // indices of descriptors, from 1
    std::uint32_t interval = kDefaultInterval;
    std::uint8_t exposure_mode = 2;     // 1 manual, 2 automatic
    std::uint32_t exposure_time = 333;  // 100 us
    std::uint32_t gain = 16;
    std::uint8_t white_balance_auto = 1;
  };

  struct Frame {
    Nanoseconds ready = 0;
    Bytes data;
    bool flag_error = false;
    std::size_t sent = 0;
  };

  const UvcFormat& format() const { return kUvcFormats[settings_.format - 1u]; }
  const UvcSize& size() const { return kUvcSizes[settings_.size - 1u]; }
  Bytes probe() const;
  void set_probe(ByteView data);
  std::optional<Bytes> streaming_in(const Setup& setup) const;
  bool streaming_out(const Setup& setup, ByteView data);
  void start();
  void stop();
  void begin_exposure(Nanoseconds time);
  void end_exposure();
  Bytes picture(const Levels& levels, Nanoseconds exposed) const;
  void send();

  int index_;
  const Scene& scene_;
  Settings settings_;
  bool streaming_ = false, free_running_ = false;
  int exposures_ = 0;
  std::optional<Exposure> exposing_;
  Nanoseconds next_start_ = 0;  // while it runs free
  std::deque<Frame> frames_;    // to be sent
  bool frame_id_ = false;       // toggles from frame to frame
};

}  // namespace lightstage::hil
