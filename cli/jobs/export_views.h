// A scan's cameras, with a picture of each, as programs of photogrammetry and radiance fields read them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "db/store.h"

namespace lightstage::cli {

// Both put `images/CAMERA.png` (sRGB, one scale for all cameras) beside their files; world coordinates are the stage frame's, in metres.
enum class ViewFormat {
  // COLMAP's text model in `sparse/`: cameras.txt (OPENCV: fx fy cx cy k1 k2 p1 p2; FULL_OPENCV with a k3; PINHOLE without distortion),
  // images.txt (world-to-camera quaternion w x y z and translation; axes x right, y down, z forward), points3D.txt without points. The
  // principal point counts from the top left pixel's corner, where ours counts from its centre: it is half a pixel larger.
  kColmap,
  // transforms.json as of instant-ngp and nerfstudio: transform_matrix is camera-to-world with OpenGL's camera axes (x right, y up, z
  // backwards); fl_x, fl_y, cx, cy, k1, k2, k3, p1, p2 as above.
  kTransforms,
};

struct ExportViewsOptions {
  ViewFormat format = ViewFormat::kColmap;
  // Pictures as by pinhole cameras (core/undistortion.h), with masks of what the lens saw: masks/CAMERA.png.png for COLMAP,
  // masks/CAMERA.png and mask_path for transforms.json.
  bool undistort = false;
  std::optional<int> light_index;  // the frame under this light; without: the key frame, under all lights
};

// The folder must not exist or be empty; it appears only when all is written. Cameras as calibrated (stage_cameras.h). Throws UsageError for
// scans that were not captured and lights that they do not have, StoreError for missing frames.
void export_views(const db::Store& store, const std::string& scan, const std::filesystem::path& folder,
                  const ExportViewsOptions& options);

}  // namespace lightstage::cli
