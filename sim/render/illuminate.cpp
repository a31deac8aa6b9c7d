#include "sim/render/illuminate.h"

#include <algorithm>

#include "core/parallel.h"

namespace lightstage::sim {
namespace {

// Filters the values of samples to pixels: along rows as they are made, then down the columns. `fill_row(y,
// values)` writes the samples of grid row y, zero on entry.
template <class FillRow>
core::Image filtered(const SampleGrid& grid, int channels, const FillRow& fill_row) {
  const std::vector<float> weights = filter_weights(grid.per_side());
  const std::size_t step = std::size_t(grid.per_side()), width = std::size_t(grid.image_width());
  const std::size_t depth = std::size_t(channels);

  core::Image rows(grid.rows(), grid.image_width(), channels);
  core::parallel_for(std::size_t(grid.rows()), 4, [&](std::size_t first, std::size_t last) {
    std::vector<float> values(std::size_t(grid.columns()) * depth);
    for (std::size_t y = first; y < last; ++y) {
      std::fill(values.begin(), values.end(), 0.0F);
      if (!fill_row(y, std::span(values))) continue;
      float* out = rows.pixel(int(y), 0);
      for (std::size_t x = 0; x < width; ++x) {
        for (std::size_t tap = 0; tap < weights.size(); ++tap) {
          for (std::size_t c = 0; c < depth; ++c)
            out[x * depth + c] += weights[tap] * values[(x * step + tap) * depth + c];
        }
      }
    }
  });

  core::Image image(grid.image_height(), grid.image_width(), channels);
  core::parallel_for(std::size_t(grid.image_height()), 8, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) {
      float* out = image.pixel(int(y), 0);
      for (std::size_t tap = 0; tap < weights.size(); ++tap) {
        const float* in = rows.pixel(int(y * step + tap), 0);
        for (std::size_t i = 0; i < width * depth; ++i) out[i] += weights[tap] * in[i];
      }
    }
  });
  return image;
}

// Visibilities of all lights from one sample, in place.
void find_visibility(const Subject& subject, const SurfaceSample& sample, const LightSet& lights, Shadows shadows,
                     std::span<float> visibility) {
  if (shadows == Shadows::kInterpolated) {
    subject.visibility(sample, lights.index, visibility);
    return;
  }
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const Vec3f light = lights.position(i);
    const bool faces = dot(sample.normal, light - sample.position) > 0;
    visibility[i] = faces && !subject.shadowed(sample, light) ? 1.0F : 0.0F;
  }
}

}  // namespace

core::Image illuminate(const Subject& subject, const SurfaceBuffer& buffer, const LightSet& lights, Shadows shadows) {
  return filtered(*buffer.grid, 3, [&](std::size_t y, std::span<float> values) {
    const SurfaceBuffer::Row& row = buffer.rows[y];
    std::vector<float> visibility(lights.size());
    const auto direct = [&](const SurfaceSample& sample) {
      find_visibility(subject, sample, lights, shadows, visibility);
      return reflected_radiance(sample, lights, visibility);
    };
    for (std::size_t i = 0; i < row.samples.size(); ++i) {
      const SurfaceSample& sample = row.samples[i];
      Vec3f radiance = direct(sample);
      if (!row.bounces.empty()) {
        Vec3f arriving;
        for (int k = 0; k < kBounceRays; ++k) {
          const auto& bounce = row.bounces[i * kBounceRays + std::size_t(k)];
          if (bounce) arriving = arriving + direct(*bounce);
        }
        radiance = radiance + sample.albedo * arriving * (1.0F / kBounceRays);
      }
      float* out = values.data() + std::size_t(sample.column) * 3;
      out[0] = radiance.x;
      out[1] = radiance.y;
      out[2] = radiance.z;
    }
    return !row.samples.empty();
  });
}

core::Image coverage(const SurfaceBuffer& buffer) {
  core::Image image = filtered(*buffer.grid, 1, [&](std::size_t y, std::span<float> values) {
    for (const SurfaceSample& sample : buffer.rows[y].samples) values[std::size_t(sample.column)] = 1;
    return !buffer.rows[y].samples.empty();
  });
  for (float& value : image.values()) value = std::min(value, 1.0F);
  return image;
}

}  // namespace lightstage::sim
