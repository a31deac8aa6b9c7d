#include "sim/render/shading.h"

namespace lightstage::sim {
namespace {

// Below this cosine the viewer sees the surface edge-on; keeps the masking term finite.
constexpr float kGrazing = 1e-3F;

inline float fifth_power(float x) {
  const float x2 = x * x;
  return x2 * x2 * x;
}

}  // namespace

void LightSet::add(Vec3f position, double centre_distance, std::span<const double, 3> gain, int light_index) {
  x.push_back(position.x);
  y.push_back(position.y);
  z.push_back(position.z);
  const double scale = centre_distance * centre_distance;
  red.push_back(float(gain[0] * scale));
  green.push_back(float(gain[1] * scale));
  blue.push_back(float(gain[2] * scale));
  index.push_back(light_index);
}

Vec3f reflected_radiance(const SurfaceSample& sample, const LightSet& lights, std::span<const float> visibility) {
  const Vec3f p = sample.position, n = sample.normal, v = sample.to_viewer;
  const float nv_raw = dot(n, v);
  const float nv = nv_raw > kGrazing ? nv_raw : kGrazing;
  const float f0 = sample.f0;
  const float f90_less_f0 = f0 > 0 ? 1 - f0 : 0;
  const float a2 = sample.alpha * sample.alpha;
  const float diffuse_out = 1 - (f0 + f90_less_f0 * fifth_power(1 - (nv < 1 ? nv : 1)));
  const float mask_v = std::sqrt(a2 + (1 - a2) * nv * nv);
  const float *x = lights.x.data(), *y = lights.y.data(), *z = lights.z.data(), *visible = visibility.data();
  const float *red = lights.red.data(), *green = lights.green.data(), *blue = lights.blue.data();
  const std::size_t count = lights.size();

  float dr = 0, dg = 0, db = 0, sr = 0, sg = 0, sb = 0;
#pragma omp simd reduction(+ : dr, dg, db, sr, sg, sb)
  for (std::size_t i = 0; i < count; ++i) {
    const float lx = x[i] - p.x, ly = y[i] - p.y, lz = z[i] - p.z;
    const float inverse = 1 / std::sqrt(lx * lx + ly * ly + lz * lz);
    float nl = (lx * n.x + ly * n.y + lz * n.z) * inverse;
    nl = nl > 0 ? (nl < 1 ? nl : 1) : 0;
    const float lv = (lx * v.x + ly * v.y + lz * v.z) * inverse;
    const float irradiance = visible[i] * nl * inverse * inverse;

    // With h = (l + v) / |l + v| and |l + v|^2 = 2 + 2 l.v: (n.h)^2 = (n.l + n.v)^2 / (2 + 2 l.v), h.v =
    // sqrt((1 + l.v) / 2).
    const float half = lv > -0.99999F ? 0.5F + 0.5F * lv : 0.5e-5F;
    const float sum = nl + nv;
    float nh2 = sum * sum / (4 * half);
    nh2 = nh2 < 1 ? nh2 : 1;
    const float hv = std::sqrt(half);
    const float t = 1 - nh2 * (1 - a2);
    const float masking = nl * mask_v + nv * std::sqrt(a2 + (1 - a2) * nl * nl);
    const float fresnel = f0 + f90_less_f0 * fifth_power(hv < 1 ? 1 - hv : 0);
    // pi D V F, with D = a^2 / (pi t^2) and V = 1 / (2 masking).
    const float specular = irradiance * fresnel * a2 / (2 * t * t * masking);
    const float diffuse = irradiance * (1 - (f0 + f90_less_f0 * fifth_power(1 - nl)));
    dr += red[i] * diffuse;
    dg += green[i] * diffuse;
    db += blue[i] * diffuse;
    sr += red[i] * specular;
    sg += green[i] * specular;
    sb += blue[i] * specular;
  }
  return sample.albedo * Vec3f(dr, dg, db) * diffuse_out + Vec3f(sr, sg, sb);
}

}  // namespace lightstage::sim
