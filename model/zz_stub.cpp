#include "core/error.h"
#include "model/checkpoint.h"
#include "model/superres.h"
#include "model/training.h"
namespace lightstage::model {
TrainReport train(std::span<const core::OlatScan>, const TrainOptions&, const std::filesystem::path&) { throw core::UsageError("x"); }
CheckpointInfo read_checkpoint_info(const std::filesystem::path&) { throw core::UsageError("x"); }
NetworkConfig network_preset(const std::string&) { return {}; }
std::unique_ptr<LightInterpolator> make_superres(const core::OlatScan&, const std::filesystem::path&, std::size_t) { throw core::UsageError("x"); }
}
