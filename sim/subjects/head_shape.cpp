#include "sim/subjects/head_shape.h"

#include <algorithm>

namespace lightstage::sim {
namespace {

// Distances and blends after Quilez, "Distance functions" (iquilezles.org/articles/distfunctions).
float ellipsoid(Vec3f p, Vec3f radii) {
  const Vec3f scaled{p.x / radii.x, p.y / radii.y, p.z / radii.z};
  const Vec3f steep{scaled.x / radii.x, scaled.y / radii.y, scaled.z / radii.z};
  const float k0 = norm(scaled), k1 = norm(steep);
  return k1 > 0 ? k0 * (k0 - 1) / k1 : -std::min({radii.x, radii.y, radii.z});
}

// A capsule whose radius changes along it.
float round_cone(Vec3f p, Vec3f a, Vec3f b, float radius_a, float radius_b) {
  const Vec3f along = b - a;
  const float t = std::clamp(dot(p - a, along) / dot(along, along), 0.0F, 1.0F);
  return norm(p - a - along * t) - (radius_a + (radius_b - radius_a) * t);
}

float join(float a, float b, float softness) {
  const float h = std::max(softness - std::abs(a - b), 0.0F) / softness;
  return std::min(a, b) - h * h * softness * 0.25F;
}

float carve(float body, float tool, float softness) {
  return -join(-body, tool, softness);
}

}  // namespace

HeadTraits::HeadTraits(std::uint64_t seed) {
  std::uint64_t counter = 0;
  const auto vary = [&](double middle, double spread) {
    return float(middle * (1 + spread * std::clamp(normal(mix(seed, 11), counter++), -2.0, 2.0)));
  };
  skull_width = vary(1, 0.025);
  skull_height = vary(1, 0.02);
  face_width = vary(1, 0.03);
  jaw_width = vary(1, 0.06);
  chin_length = vary(1, 0.03);
  chin_forward = vary(1, 0.03);
  cheekbones = vary(1, 0.06);
  brow_ridge = vary(1, 0.15);
  eye_distance = vary(3.15, 0.025);
  eye_size = vary(1.22, 0.02);
  eye_opening = vary(1, 0.08);
  nose_length = vary(1, 0.05);
  nose_width = vary(1, 0.09);
  nose_height = vary(1, 0.07);
  nose_tip = vary(1, 0.08);
  lip_fullness = vary(1, 0.14);
  mouth_width = vary(1, 0.06);
  ear_size = vary(1, 0.07);
  neck_width = vary(1, 0.06);
  hair_thickness = vary(0.9, 0.25);
  hairline = vary(1, 0.06);
}

HeadShape::HeadShape(std::uint64_t seed) : traits_(seed), noise_(mix(seed, 12)) {}

Box HeadShape::bounds() const {
  return {{-10.5F, -17, -13}, {10.5F, 14.5F, 14}};
}

Vec3f HeadShape::eye_centre() const {
  return {traits_.eye_distance, 0, 7.15F};
}
float HeadShape::eye_radius() const {
  return traits_.eye_size;
}
Vec3f HeadShape::mouth() const {
  return {0, -6.7F * traits_.chin_length, 9.3F};
}

float HeadShape::skull(Vec3f p) const {
  const Vec3f radii{7.35F * traits_.skull_width, 8.4F * traits_.skull_height, 9.3F};
  const float cranium = ellipsoid(p - Vec3f(0, 3.1F, -0.7F), radii);
  const float forehead = ellipsoid(p - Vec3f(0, 4.0F, 2.9F), {5.9F * traits_.skull_width, 4.6F, 5.6F});
  return join(cranium, forehead, 2.0F);
}

float HeadShape::hair_depth(Vec3f p) const {
  // The hairline: high over the forehead, down in front of the ears, round behind them and low at the nape.
  const float x = std::abs(p.x);
  const float temple = smooth_step(3.5F, 6.6F, x);
  const float front = (6.9F * traits_.hairline - 0.02F * x * x) * (1 - temple) + 1.2F * temple;
  const float around = smooth_step(-0.5F, 3.0F, p.z);
  const float behind = -5.5F + 4.5F * smooth_step(-4.0F, 0.5F, p.z);
  const float edge = behind + (front - behind) * around;
  return p.y - edge + 0.35F * noise_.octaves(p * 1.1F, 2);
}

float HeadShape::face(Vec3f q) const {
  const HeadTraits& t = traits_;
  const float low = t.chin_length;
  float d = skull(q);
  d = join(d, ellipsoid(q - Vec3f(0, -2.6F, 1.5F), {6.1F * t.face_width, 7.6F, 7.0F}), 2.0F);
  // Jaw: from below the ear to the chin.
  d = join(
      d,
      round_cone(q, {4.35F * t.jaw_width, -5.6F * low, 0.4F}, {1.1F, -10.1F * low, 6.9F * t.chin_forward}, 1.8F, 1.3F),
      3.0F);
  d = join(d, ellipsoid(q - Vec3f(0, -10.2F * low, 7.35F * t.chin_forward), {1.8F, 1.35F, 1.35F}), 1.5F);
  // Cheekbone and the flesh below it.
  d = join(d, ellipsoid(q - Vec3f(4.5F * t.face_width, -2.0F, 5.6F), {1.9F * t.cheekbones, 1.3F, 1.8F * t.cheekbones}),
           1.6F);
  d = join(d, ellipsoid(q - Vec3f(3.3F, -4.3F, 6.2F), {2.0F, 2.4F, 1.9F}), 1.6F);
  // The muzzle under nose and lips.
  d = join(d, ellipsoid(q - Vec3f(0, -6.3F * low, 6.6F), {2.9F * t.mouth_width, 2.7F, 2.55F}), 1.5F);
  // Brow.
  d = join(d, round_cone(q, {0.9F, 1.75F, 8.1F}, {4.3F, 1.9F, 6.6F}, 0.62F * t.brow_ridge, 0.5F * t.brow_ridge), 1.0F);
  return d;
}

float HeadShape::nose(Vec3f q) const {
  const HeadTraits& t = traits_;
  const float bottom = -3.9F * t.nose_length, out = 8.8F + 1.95F * t.nose_height;
  float d = round_cone(q, {0, 1.0F, 8.15F}, {0, bottom + 0.35F, out - 0.55F}, 0.55F, 0.72F * t.nose_width);
  d = join(d,
           ellipsoid(q - Vec3f(0, bottom + 0.25F, out - 0.5F),
                     {0.95F * t.nose_width, 0.82F * t.nose_tip, 0.85F * t.nose_tip}),
           0.6F);
  d = join(d, ellipsoid(q - Vec3f(1.25F * t.nose_width, bottom - 0.05F, out - 1.75F), {0.62F, 0.68F, 0.95F}), 0.55F);
  return d;
}

float HeadShape::ear_distance(Vec3f p) const {
  // A plate that leans back and whose rear edge stands off the head; rim, inner fold, hollow and the flap before it.
  const Vec3f from_root =
      (Vec3f(std::abs(p.x), p.y, p.z) - Vec3f(7.35F * traits_.skull_width, -0.8F, -0.9F)) * (1 / traits_.ear_size);
  if (norm(from_root) > 6) return norm(from_root) - 4;
  constexpr float kLean = 0.2F, kFlare = 0.45F;
  const float y = from_root.y * std::cos(kLean) - from_root.z * std::sin(kLean);
  const float forward = from_root.y * std::sin(kLean) + from_root.z * std::cos(kLean);
  const float x = from_root.x * std::cos(kFlare) + forward * std::sin(kFlare);
  const float z = forward * std::cos(kFlare) - from_root.x * std::sin(kFlare);
  // An egg, narrow at the lobe.
  const Vec3f e{x, y, z / (1 - 0.075F * std::clamp(3.0F - y, 0.0F, 6.0F))};
  float d = ellipsoid(e, {0.42F, 3.05F, 1.85F});
  d = carve(d, ellipsoid(e - Vec3f(0.55F, 0.9F, -0.1F), {0.42F, 1.75F, 1.3F}), 0.2F);
  const float rim = std::hypot((std::hypot(e.y / 2.8F, e.z / 1.6F) - 1) * 1.8F, e.x - 0.3F) - 0.27F;
  if (e.y > -1.8F) d = join(d, rim, 0.25F);
  const float fold =
      std::hypot((std::hypot((e.y - 0.2F) / 1.75F, (e.z - 0.35F) / 1.25F) - 1) * 1.3F, e.x - 0.2F) - 0.24F;
  if (e.z < 0.7F) d = join(d, fold, 0.3F);
  d = carve(d, ellipsoid(e - Vec3f(0.5F, -0.35F, 0.55F), {0.7F, 1.0F, 0.75F}), 0.25F);
  d = join(d, ellipsoid(e - Vec3f(0.25F, -0.55F, 1.45F), {0.35F, 0.5F, 0.3F}), 0.3F);
  return d * traits_.ear_size;
}

float HeadShape::distance(Vec3f p) const {
  const HeadTraits& t = traits_;
  // No face is symmetric.
  const Vec3f askew = p + Vec3f(noise_(p * 0.13F), noise_(p * 0.13F + Vec3f(31, 0, 0)), 0) * 0.16F;
  const Vec3f q{std::sqrt(askew.x * askew.x + 1e-4F), askew.y, askew.z};

  float d = face(q);
  // Eye sockets and temples are hollow.
  const Vec3f eye = eye_centre();
  d = carve(d, ellipsoid(q - eye - Vec3f(-0.1F, 0.15F, 1.75F), {1.75F, 1.0F, 1.15F}), 0.9F);
  d = join(d, nose(q), 0.75F);
  const float nose_bottom = -3.9F * t.nose_length, nose_out = 8.8F + 1.95F * t.nose_height;
  d = carve(d, ellipsoid(q - Vec3f(0.62F * t.nose_width, nose_bottom - 0.62F, nose_out - 1.35F), {0.36F, 0.5F, 0.55F}),
            0.25F);

  // Lips: an upper one in a bow, a fuller lower one, and the line between.
  const Vec3f m = mouth();
  const float wide = t.mouth_width, full = t.lip_fullness;
  const float curve = 0.14F * q.x * q.x;  // lips run back around the teeth
  const Vec3f lip = q - m + Vec3f(0, 0, curve);
  float lips = ellipsoid(lip - Vec3f(0.65F, 0.34F * full, -0.52F), {1.75F * wide, 0.46F * full, 0.62F});
  lips = join(lips, ellipsoid(lip - Vec3f(0, -0.48F * full, -0.55F), {1.75F * wide, 0.54F * full, 0.66F}), 0.15F);
  d = join(d, lips, 0.35F);
  d = carve(d, ellipsoid(lip - Vec3f(0, -0.02F, 0.1F), {2.35F * wide, 0.09F, 0.6F}), 0.16F);
  d = carve(d, ellipsoid(lip - Vec3f(2.45F * wide, -0.05F, 0.05F), {0.3F, 0.22F, 0.4F}), 0.5F);
  d = carve(d, round_cone(q, m + Vec3f(0, 0.95F, 0.55F), m + Vec3f(0, 1.9F, 0.6F), 0.28F, 0.2F), 0.5F);

  // Lids: a sphere about the eyeball with an almond cut out of it.
  const Vec3f e = q - eye;
  const float opening = 0.50F * t.eye_opening;
  const float lids = norm(e) - (t.eye_size + 0.2F);
  d = join(d, lids, 0.35F);
  const float almond_radius = (1.45F * 1.45F + opening * opening) / (2 * opening);
  const float lift = almond_radius - opening;
  // The outer corner a little higher than the inner one; extruded forward.
  const float ey = e.y - 0.06F * e.x + 0.05F;
  const float almond = std::max(std::hypot(e.x, ey + lift) - almond_radius, std::hypot(e.x, ey - lift) - almond_radius);
  d = carve(d, std::max(almond, 0.3F - e.z), 0.1F);
  d = std::min(d, norm(e) - t.eye_size);

  d = join(d, ear_distance(q), 0.3F);
  // Neck, with the muscle that runs from behind the ear to the collar bone; cut flat below.
  float neck = round_cone(q, {0, -4.0F, -2.6F}, {0, -18.0F, -3.4F}, 4.9F * t.neck_width, 5.4F * t.neck_width);
  neck = join(neck, round_cone(q, {5.4F, -5.0F, -2.4F}, {1.5F, -17.0F, 1.6F}, 1.2F, 1.1F), 1.5F);
  d = join(d, neck, 1.6F);

  // Hair: a shell over the skull, combed back.
  const float depth = hair_depth(p);
  if (depth > -1.5F) {
    const float strands = noise_.octaves(Vec3f(p.x * 1.7F, p.y * 0.9F, p.z * 0.5F), 2);
    const float thickness = t.hair_thickness * smooth_step(-0.4F, 3.4F, depth) * (1 + 0.22F * strands) - 0.25F;
    const float shell = skull(p) - thickness;
    d = join(d, std::max(shell, -0.7F * depth - 0.2F), 0.25F);
  }
  d += 0.03F * noise_.octaves(p * 0.8F, 2);
  return std::max(d, -14.6F - p.y);
}

}  // namespace lightstage::sim
