// Smooth noise and smooth steps.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "sim/render/vec3f.h"
#include "sim/scene/random.h"

namespace lightstage::sim {

// 0 up to `low`, 1 from `high` on (the other way round where low > high), a cubic between.
inline float smooth_step(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0F, 1.0F);
  return t * t * (3 - 2 * t);
}

// Value noise: random values in [-1, 1] at integer points, blended by quintic curves between (twice
// differentiable).
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : seed_(std::uint32_t(mix(seed))) {}

  float operator()(Vec3f place) const {
    // Turned, so that no axis of the subject runs along the lattice.
    const Vec3f p{0.36F * place.x + 0.48F * place.y - 0.80F * place.z, -0.80F * place.x + 0.60F * place.y,
                  0.48F * place.x + 0.64F * place.y + 0.60F * place.z};
    const float fx = std::floor(p.x), fy = std::floor(p.y), fz = std::floor(p.z);
    const int x = int(fx), y = int(fy), z = int(fz);
    const float tx = curve(p.x - fx), ty = curve(p.y - fy), tz = curve(p.z - fz);
    const auto along_x = [&](int yy, int zz) { return blend(at(x, yy, zz), at(x + 1, yy, zz), tx); };
    return blend(blend(along_x(y, z), along_x(y + 1, z), ty), blend(along_x(y, z + 1), along_x(y + 1, z + 1), ty), tz);
  }

  // Octaves of doubling frequency and halving strength; within [-2, 2].
  float octaves(Vec3f p, int count) const {
    float sum = 0, strength = 1;
    for (int i = 0; i < count; ++i) {
      sum += strength * (*this)(p);
      p = p * 2.03F + Vec3f(17.1F, 5.7F, 9.3F);
      strength *= 0.5F;
    }
    return sum;
  }

 private:
  static float curve(float t) { return t * t * t * (t * (t * 6 - 15) + 10); }
  static float blend(float a, float b, float t) { return a + (b - a) * t; }
  float at(int x, int y, int z) const {
    std::uint32_t h =
        seed_ ^ (std::uint32_t(x) * 0x8da6b343u) ^ (std::uint32_t(y) * 0xd8163841u) ^ (std::uint32_t(z) * 0xcb1ab31fu);
    h = (h ^ (h >> 16)) * 0x7feb352du;
    h = (h ^ (h >> 15)) * 0x846ca68bu;
    h ^= h >> 16;
    return float(h) * (2.0F / 4294967296.0F) - 1;
  }

  std::uint32_t seed_;
};

}  // namespace lightstage::sim
