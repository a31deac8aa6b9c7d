#include "model/net/transposed_convolution.h"

#include <torch/torch.h>

#include <array>

namespace lightstage::model {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::tensor_list;

Tensor channels_last(const Tensor& x) {
  return x.contiguous(at::MemoryFormat::ChannelsLast);
}

// The gradients of y = conv2d(image, weight, stride 2, padding 1): by image, by weight, or both.
std::tuple<Tensor, Tensor, Tensor> halving_gradients(const Tensor& dy, const Tensor& image, const Tensor& weight,
                                                     std::array<bool, 3> wanted) {
  return at::convolution_backward(dy, image, weight, c10::nullopt, {2, 2}, {1, 1}, {1, 1}, /*transposed=*/false, {0, 0},
                                  /*groups=*/1, wanted);
}

struct DoublingConvolution : torch::autograd::Function<DoublingConvolution> {
  static Tensor forward(AutogradContext* context, const Tensor& input, const Tensor& weight, const Tensor& bias) {
    const Tensor x = channels_last(input), w = channels_last(weight);
    // Of the image only the shape counts; no memory is touched.
    const Tensor shape =
        torch::empty({x.size(0), w.size(1), 2 * x.size(2), 2 * x.size(3)}, x.options(), at::MemoryFormat::ChannelsLast);
    Tensor y = std::get<0>(halving_gradients(x, shape, w, {true, false, false}));
    y.add_(bias.view({1, -1, 1, 1}));
    context->save_for_backward({x, w});
    return y;
  }

  static tensor_list backward(AutogradContext* context, tensor_list gradients) {
    const auto saved = context->get_saved_variables();
    const Tensor &x = saved[0], &w = saved[1];
    const Tensor dy = channels_last(gradients[0]);
    Tensor dx, dw, dbias;
    if (context->needs_input_grad(0)) dx = at::conv2d(dy, w, {}, /*stride=*/2, /*padding=*/1);
    if (context->needs_input_grad(1)) dw = std::get<1>(halving_gradients(x, dy, w, {false, true, false}));
    if (context->needs_input_grad(2)) dbias = dy.sum({0, 2, 3});
    return {dx, dw, dbias};
  }
};

}  // namespace

Tensor doubling_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  return DoublingConvolution::apply(x, weight, bias);
}

}  // namespace lightstage::model
