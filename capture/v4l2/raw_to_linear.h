// From a camera's numbers to linear radiance: black level, linearisation, demosaic.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "capture/hardware.h"
#include "capture/v4l2/pixel_format.h"
#include "capture/v4l2/unpack.h"
#include "core/image.h"

namespace lightstage::capture {

// How RGB24 and YUYV encode light, as the driver tells. Grey and mosaic formats are the sensor's own numbers: of them
// drivers repeat what they say of colour formats, and it is not looked at.
struct ColourEncoding {
  enum class Transfer { kLinear, kSrgb, kRec709 };
  enum class Matrix { kRec601, kRec709 };
  Transfer transfer = Transfer::kSrgb;
  Matrix matrix = Matrix::kRec601;  // of YUYV
  bool full_range = false;          // of YUYV; false: Y from 16 to 235, Cb and Cr from 16 to 240
};

// The inverse of the transfer function: IEC 61966-2-1, or ITU-R BT.709-6, item 1.2; both odd about 0.
double decode(ColourEncoding::Transfer transfer, double encoded);

// In turn:
//   colour     (YUYV alone) R, G, B by the matrix and range of the encoding, in codes of 0 to 255, clipped above
//   black      s = (code - black level) / (top code - black level)
//   linear     signal = c1 s + c2 s^2 + ... with the coefficients of CameraDevice::linearisation, odd about 0 so that noise
//              about black keeps its mean. Where those are the default (or none), RGB24 and YUYV are decoded by their
//              transfer function instead; write {1, 0} for a camera whose RGB24 is linear although its driver says otherwise
//   demosaic   (Bayer alone) edge-aware, by OpenCV, on 16 bits of the linear signal; an edge's green is taken along it. The
//              outermost rows and columns repeat their neighbours
// and radiance = signal * radiance_per_signal, which is 1 / (responsivity * exposure seconds). Values may be slightly below
// 0 (noise about black), none is above that of the top code. Colours stay the camera's own: no colour matrix is applied.
class RawToLinear {
 public:
  // Throws BadInput naming the camera when the black level is not within [0, top code), or the signal would not rise from
  // code to code.
  RawToLinear(const std::string& camera, const PixelFormat& format, const CameraDevice& device,
              const ColourEncoding& encoding);

  // Signal of the top code: what times radiance_per_signal is the radiance at which the sensor clips.
  double top_signal() const { return signal_of_code_.back(); }

  // `picture` as unpacked from the constructor's format; mosaics must be 4x4 pixels at least.
  core::Image image(const RawPicture& picture, double radiance_per_signal) const;

 private:
  double signal(double code) const;
  float colour_signal(float code) const;  // the same from a table, for R, G and B between the codes
  core::Image look_up(const RawPicture& picture, double radiance_per_signal) const;
  core::Image from_yuyv(const RawPicture& picture, double radiance_per_signal) const;
  core::Image demosaic(const RawPicture& picture, double radiance_per_signal) const;

  PixelFormat format_;
  double black_level_;
  std::vector<double> polynomial_;  // empty: by encoding_
  ColourEncoding encoding_;
  std::vector<float> signal_of_code_;
  std::vector<float> colour_signal_;
  // Mosaics: the signal on 16 bits, which loses nothing of a linear sensor's codes; signal = demosaic_black_ + code *
  // demosaic_step_.
  std::vector<std::uint16_t> demosaic_code_;
  double demosaic_black_ = 0, demosaic_step_ = 1;
};

}  // namespace lightstage::capture
