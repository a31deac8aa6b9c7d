// Checkpoints.
#include "model/net/safetensors.h"

#include "fuzz/target.h"
#include "model/checkpoint.h"

namespace lightstage::fuzz {

namespace {

const Registration kSafetensors({"safetensors", [](Bytes bytes) {
                                   const auto file = write(scratch() / "a.safetensors", bytes);
                                   tolerate([&] { model::chosen_directions(file); });
                                   const auto header = model::read_safetensors_header(file);
                                   for (const model::StoredTensor& tensor : header.tensors) {
                                     require(model::value_count(tensor.info) == tensor.value_count,
                                             "a tensor has the values of its shape");
                                     tolerate([&] { model::read_tensor(file, tensor); });
                                   }
                                 }});

}  // namespace

}  // namespace lightstage::fuzz
