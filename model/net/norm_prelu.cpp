#include "model/net/norm_prelu.h"

#include <ATen/Parallel.h>

#include <cmath>
#include <vector>

#include "model/engine/channel_loops.h"

namespace lightstage::model {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::tensor_list;

constexpr double kEpsilon = 1e-5;
constexpr std::int64_t kPixelsPerBlock = 2048;

// [n, channels, h, w] in channels_last memory, seen as images of pixels of channels, and cut into blocks of pixels that never span
// two images: each thread takes whole blocks, and sums are added up block after block.
struct Layout {
  std::int64_t images, pixels, channels, blocks_per_image;

  explicit Layout(const Tensor& x)
      : images(x.size(0)),
        pixels(x.size(2) * x.size(3)),
        channels(x.size(1)),
        blocks_per_image((pixels + kPixelsPerBlock - 1) / kPixelsPerBlock) {}

  std::int64_t blocks() const { return images * blocks_per_image; }

  // body(block, image, first value, pixels in the block)
  template <class Body>
  void for_each_block(const Body& body) const {
    at::parallel_for(0, blocks(), 1, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t block = begin; block < end; ++block) {
        const std::int64_t image = block / blocks_per_image;
        const std::int64_t first = block % blocks_per_image * kPixelsPerBlock;
        body(block, image, (image * pixels + first) * channels, std::min(kPixelsPerBlock, pixels - first));
      }
    });
  }

  // Adds up the `width` numbers a block that were left in `partial`, to `width` an image.
  std::vector<double> sum_per_image(const std::vector<double>& partial, std::int64_t width) const {
    std::vector<double> sums(std::size_t(images * width), 0.0);
    for (std::int64_t block = 0; block < blocks(); ++block) {
      for (std::int64_t i = 0; i < width; ++i) {
        sums[std::size_t(block / blocks_per_image * width + i)] += partial[std::size_t(block * width + i)];
      }
    }
    return sums;
  }
};

Tensor channels_last(const Tensor& x) {
  return x.contiguous(at::MemoryFormat::ChannelsLast);
}

// Per image and channel, so that scale * (x - mean) / deviation + shift = gain * x + offset.
struct Affine {
  std::vector<float> gain, offset;

  ChannelAffine of_image(std::int64_t image, std::int64_t channels, const float* slope) const {
    return {gain.data() + image * channels, offset.data() + image * channels, slope};
  }
};

struct Statistics {
  std::vector<double> mean, inverse_deviation;  // per image and group
};

Statistics statistics(const Layout& layout, const float* x, std::int64_t groups) {
  const std::int64_t channels = layout.channels;
  std::vector<double> partial(std::size_t(layout.blocks() * 2 * channels), 0.0);
  layout.for_each_block([&](std::int64_t block, std::int64_t, std::int64_t first, std::int64_t pixels) {
    channel_loops().add_moments(x + first, pixels, channels, partial.data() + block * 2 * channels);
  });
  const std::vector<double> sums = layout.sum_per_image(partial, 2 * channels);

  Statistics result;
  const std::int64_t per_group = channels / groups;
  const double count = double(layout.pixels * per_group);
  for (std::int64_t image = 0; image < layout.images; ++image) {
    for (std::int64_t group = 0; group < groups; ++group) {
      double sum = 0, squares = 0;
      for (std::int64_t c = group * per_group; c < (group + 1) * per_group; ++c) {
        sum += sums[std::size_t(image * 2 * channels + c)];
        squares += sums[std::size_t((image * 2 + 1) * channels + c)];
      }
      const double mean = sum / count;
      // In float64 the difference keeps 7 digits while the mean is below 1e4 deviations, which is all that float32 values resolve.
      const double variance = std::max(0.0, squares / count - mean * mean);
      result.mean.push_back(mean);
      result.inverse_deviation.push_back(1 / std::sqrt(variance + kEpsilon));
    }
  }
  return result;
}

Affine affine(const Layout& layout, const Statistics& s, const float* scale, const float* shift, std::int64_t groups) {
  Affine result;
  const std::int64_t per_group = layout.channels / groups;
  for (std::int64_t image = 0; image < layout.images; ++image) {
    for (std::int64_t c = 0; c < layout.channels; ++c) {
      const std::size_t g = std::size_t(image * groups + c / per_group);
      const double gain = scale[c] * s.inverse_deviation[g];
      result.gain.push_back(float(gain));
      result.offset.push_back(float(shift[c] - gain * s.mean[g]));
    }
  }
  return result;
}

Tensor to_tensor(const std::vector<double>& values) {
  return torch::tensor(values, torch::TensorOptions().dtype(torch::kFloat64));
}

std::vector<double> to_vector(const Tensor& values) {
  const double* const data = values.data_ptr<double>();
  return {data, data + values.numel()};
}

struct NormPrelu : torch::autograd::Function<NormPrelu> {
  static Tensor forward(AutogradContext* context, const Tensor& input, const Tensor& scale, const Tensor& shift,
                        const Tensor& slope, std::int64_t groups) {
    const Tensor x = channels_last(input);
    const Layout layout(x);
    const Statistics s = statistics(layout, x.data_ptr<float>(), groups);
    const Affine a = affine(layout, s, scale.data_ptr<float>(), shift.data_ptr<float>(), groups);
    Tensor y = torch::empty_like(x, at::MemoryFormat::ChannelsLast);
    const float* const slopes = slope.data_ptr<float>();
    layout.for_each_block([&](std::int64_t, std::int64_t image, std::int64_t first, std::int64_t pixels) {
      channel_loops().apply(x.data_ptr<float>() + first, pixels, layout.channels,
                            a.of_image(image, layout.channels, slopes), y.data_ptr<float>() + first);
    });
    context->saved_data["groups"] = groups;
    context->save_for_backward({x, scale, shift, slope, to_tensor(s.mean), to_tensor(s.inverse_deviation)});
    return y;
  }

  static tensor_list backward(AutogradContext* context, tensor_list gradients) {
    const auto saved = context->get_saved_variables();
    const Tensor &x = saved[0], &scale = saved[1], &shift = saved[2], &slope = saved[3];
    const std::int64_t groups = context->saved_data["groups"].toInt();
    const Tensor dy = channels_last(gradients[0]);
    const Layout layout(x);
    const std::int64_t channels = layout.channels, per_group = channels / groups;
    const Statistics s{to_vector(saved[4]), to_vector(saved[5])};
    const Affine a = affine(layout, s, scale.data_ptr<float>(), shift.data_ptr<float>(), groups);
    const float* const slopes = slope.data_ptr<float>();

    // Per block and channel: the sums of dz, of dz x and of dy min(z, 0), where dz is the gradient before the PReLU.
    std::vector<double> partial(std::size_t(layout.blocks() * 3 * channels), 0.0);
    layout.for_each_block([&](std::int64_t block, std::int64_t image, std::int64_t first, std::int64_t pixels) {
      channel_loops().add_gradients(x.data_ptr<float>() + first, dy.data_ptr<float>() + first, pixels, channels,
                                    a.of_image(image, channels, slopes), partial.data() + block * 3 * channels);
    });
    const std::vector<double> sums = layout.sum_per_image(partial, 3 * channels);

    // With n = (x - mean) / deviation: d scale = sum dz n, d shift = sum dz, and, means taken over the group,
    // dx = (scale dz - mean(scale dz) - n mean(scale dz n)) / deviation = factor dz + tilt x + level.
    std::vector<double> d_scale(std::size_t(channels), 0.0), d_shift = d_scale, d_slope = d_scale;
    std::vector<float> tilt, level;  // per image and channel
    const double count = double(layout.pixels * per_group);
    for (std::int64_t image = 0; image < layout.images; ++image) {
      const double* const sum = sums.data() + image * 3 * channels;
      for (std::int64_t group = 0; group < groups; ++group) {
        const double mean = s.mean[std::size_t(image * groups + group)];
        const double inverse = s.inverse_deviation[std::size_t(image * groups + group)];
        double mean_dn = 0, mean_dn_n = 0;
        for (std::int64_t c = group * per_group; c < (group + 1) * per_group; ++c) {
          const double dz_n = (sum[channels + c] - mean * sum[c]) * inverse;
          d_scale[std::size_t(c)] += dz_n;
          d_shift[std::size_t(c)] += sum[c];
          d_slope[std::size_t(c)] += sum[2 * channels + c];
          const double scale_c = scale.data_ptr<float>()[c];
          mean_dn += scale_c * sum[c] / count;
          mean_dn_n += scale_c * dz_n / count;
        }
        for (std::int64_t c = 0; c < per_group; ++c) {
          tilt.push_back(float(-inverse * inverse * mean_dn_n));
          level.push_back(float(inverse * (inverse * mean * mean_dn_n - mean_dn)));
        }
      }
    }
    Tensor dx = torch::empty_like(x, at::MemoryFormat::ChannelsLast);
    layout.for_each_block([&](std::int64_t, std::int64_t image, std::int64_t first, std::int64_t pixels) {
      channel_loops().gradient(x.data_ptr<float>() + first, dy.data_ptr<float>() + first, pixels, channels,
                               a.of_image(image, channels, slopes), tilt.data() + image * channels,
                               level.data() + image * channels, dx.data_ptr<float>() + first);
    });
    return {dx, to_tensor(d_scale).to(torch::kFloat32), to_tensor(d_shift).to(torch::kFloat32),
            to_tensor(d_slope).to(torch::kFloat32), Tensor()};
  }
};

struct Prelu : torch::autograd::Function<Prelu> {
  static Tensor forward(AutogradContext* context, const Tensor& input, const Tensor& slope) {
    const Tensor x = channels_last(input);
    const Layout layout(x);
    Tensor y = torch::empty_like(x, at::MemoryFormat::ChannelsLast);
    const float* const slopes = slope.data_ptr<float>();
    layout.for_each_block([&](std::int64_t, std::int64_t, std::int64_t first, std::int64_t pixels) {
      const float* in = x.data_ptr<float>() + first;
      float* out = y.data_ptr<float>() + first;
      for (std::int64_t p = 0; p < pixels; ++p, in += layout.channels, out += layout.channels) {
        for (std::int64_t c = 0; c < layout.channels; ++c) out[c] = in[c] > 0 ? in[c] : slopes[c] * in[c];
      }
    });
    context->save_for_backward({x, slope});
    return y;
  }

  static tensor_list backward(AutogradContext* context, tensor_list gradients) {
    const auto saved = context->get_saved_variables();
    const Tensor &x = saved[0], &slope = saved[1];
    const Tensor dy = channels_last(gradients[0]);
    const Layout layout(x);
    const std::int64_t channels = layout.channels;
    const float* const slopes = slope.data_ptr<float>();
    Tensor dx = torch::empty_like(x, at::MemoryFormat::ChannelsLast);
    std::vector<double> partial(std::size_t(layout.blocks() * channels), 0.0);
    layout.for_each_block([&](std::int64_t block, std::int64_t, std::int64_t first, std::int64_t pixels) {
      double* const sum = partial.data() + block * channels;
      const float* in = x.data_ptr<float>() + first;
      const float* up = dy.data_ptr<float>() + first;
      float* out = dx.data_ptr<float>() + first;
      for (std::int64_t p = 0; p < pixels; ++p, in += channels, up += channels, out += channels) {
        for (std::int64_t c = 0; c < channels; ++c) {
          out[c] = in[c] > 0 ? up[c] : slopes[c] * up[c];
          sum[c] += in[c] > 0 ? 0.0 : double(up[c]) * in[c];
        }
      }
    });
    const std::vector<double> per_image = layout.sum_per_image(partial, channels);
    std::vector<double> d_slope(std::size_t(channels), 0.0);
    for (std::size_t i = 0; i < per_image.size(); ++i) d_slope[i % std::size_t(channels)] += per_image[i];
    return {dx, to_tensor(d_slope).to(torch::kFloat32)};
  }
};

}  // namespace

Tensor norm_prelu(const Tensor& x, const Tensor& scale, const Tensor& shift, const Tensor& slope, int groups) {
  return NormPrelu::apply(x, scale, shift, slope, groups);
}

Tensor channel_prelu(const Tensor& x, const Tensor& slope) {
  return Prelu::apply(x, slope);
}

}  // namespace lightstage::model
