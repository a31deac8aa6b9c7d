// The form of the procedural head: a signed distance made of blended ellipsoids and round cones, as a
// sculptor starts from balls of clay. Centimetres; x to the subject's left, y up, z forward; the origin is
// between the ears at the height of the eyes.
#pragma once

#include <cstdint>

#include "sim/subjects/isosurface.h"
#include "sim/subjects/noise.h"

namespace lightstage::sim {

// What differs between people. Lengths in centimetres, factors about 1.
struct HeadTraits {
  explicit HeadTraits(std::uint64_t seed);

  float skull_width, skull_height, face_width, jaw_width, chin_length, chin_forward;
  float cheekbones, brow_ridge, eye_distance, eye_size, eye_opening;
  float nose_length, nose_width, nose_height, nose_tip;
  float lip_fullness, mouth_width, ear_size, neck_width;
  float hair_thickness, hairline;
};

class HeadShape {
 public:
  explicit HeadShape(std::uint64_t seed);

  float distance(Vec3f p) const;
  Box bounds() const;

  const HeadTraits& traits() const { return traits_; }
  // Of the eyeball on the side of x >= 0.
  Vec3f eye_centre() const;
  float eye_radius() const;
  // The middle of the line between the lips.
  Vec3f mouth() const;
  // To the nearer ear alone.
  float ear_distance(Vec3f p) const;
  // How deep a point lies under the hair: positive in the hair, negative on bare skin, in centimetres.
  float hair_depth(Vec3f p) const;

 private:
  float skull(Vec3f p) const;
  float face(Vec3f q) const;  // q: mirrored to x >= 0
  float nose(Vec3f q) const;

  HeadTraits traits_;
  Noise noise_;
};

}  // namespace lightstage::sim
