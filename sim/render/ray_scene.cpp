#include "sim/render/ray_scene.h"

#include <embree3/rtcore.h>
#include <oneapi/tbb/task_arena.h>

#include <cstring>
#include <limits>
#include <string>

#include "core/error.h"

namespace lightstage::sim {
namespace {

struct ReleaseDevice {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct ReleaseScene {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
struct ReleaseGeometry {
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using Device = std::unique_ptr<std::remove_pointer_t<RTCDevice>, ReleaseDevice>;
using Scene = std::unique_ptr<std::remove_pointer_t<RTCScene>, ReleaseScene>;
using Geometry = std::unique_ptr<std::remove_pointer_t<RTCGeometry>, ReleaseGeometry>;

// Embree reports errors by a flag of the device (of the thread where there is no device).
void require_no_error(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error != RTC_ERROR_NONE) {
    throw core::Error(core::ErrorKind::kInternal, "Embree cannot build the scene (error " + std::to_string(int(error)) +
                                                      (error == RTC_ERROR_OUT_OF_MEMORY ? ", out of memory)" : ")"));
  }
}

template <class T>
void fill_buffer(RTCGeometry geometry, RTCBufferType type, RTCFormat format, std::span<const T> values) {
  void* buffer = rtcSetNewGeometryBuffer(geometry, type, 0, format, sizeof(T), values.size());
  if (buffer != nullptr) std::memcpy(buffer, values.data(), values.size_bytes());
}

RTCRay ray(Vec3f origin, Vec3f direction, float end) {
  RTCRay result{};
  result.org_x = origin.x;
  result.org_y = origin.y;
  result.org_z = origin.z;
  result.dir_x = direction.x;
  result.dir_y = direction.y;
  result.dir_z = direction.z;
  result.tfar = end;
  result.mask = ~0u;
  return result;
}

}  // namespace

struct RayScene::Handles {
  Device device;
  Scene scene;
};

RayScene::RayScene(std::span<const Vec3f> vertices, std::span<const Triangle> triangles)
    : handles_(std::make_unique<Handles>()) {
  handles_->device.reset(rtcNewDevice(nullptr));
  RTCDevice device = handles_->device.get();
  require_no_error(device);
  handles_->scene.reset(rtcNewScene(device));
  const Geometry geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
  fill_buffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, vertices);
  fill_buffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, triangles);
  require_no_error(device);
  rtcCommitGeometry(geometry.get());
  rtcAttachGeometry(handles_->scene.get(), geometry.get());
  // Robust: rays do not slip through edges that triangles share.
  rtcSetSceneFlags(handles_->scene.get(), RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(handles_->scene.get(), RTC_BUILD_QUALITY_HIGH);
  // Built by this thread alone, so that the hierarchy is the same every time: in an arena of one. (A device with "threads=1" would
  // hold the whole process to one thread for as long as it lives.)
  tbb::task_arena(1).execute([this] { rtcJoinCommitScene(handles_->scene.get()); });
  require_no_error(device);
}

RayScene::~RayScene() = default;
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;

std::optional<RayHit> RayScene::first_hit(Vec3f origin, Vec3f unit_direction) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray = ray(origin, unit_direction, std::numeric_limits<float>::infinity());
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(handles_->scene.get(), &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return RayHit{query.hit.primID, query.hit.u, query.hit.v};
}

bool RayScene::blocked(Vec3f from, Vec3f to) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay query = ray(from, to - from, 1);
  rtcOccluded1(handles_->scene.get(), &context, &query);
  return query.tfar < 0;
}

}  // namespace lightstage::sim
