#include "sim/subjects/texture.h"

#include <algorithm>
#include <cctype>
#include <random>
#include <system_error>

#include "core/error.h"
#include "core/file.h"
#include "core/foreign_path.h"
#include "core/image_file.h"

namespace lightstage::sim {
namespace {

namespace fs = std::filesystem;

// The image library reads files, so bytes in memory become one for as long as it reads.
class TemporaryFile {
 public:
  TemporaryFile(std::string_view bytes, const std::string& extension) {
    std::random_device random;
    path_ = fs::temp_directory_path() /
            ("lightstage-texture-" + std::to_string(random()) + "-" + std::to_string(random()) + "." + extension);
    core::write_file_atomically(path_, bytes);
  }
  ~TemporaryFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace

Vec3f look_up(const core::Image& texture, TexturePoint place) {
  if (!std::isfinite(place.u) || !std::isfinite(place.v)) place = {};
  const auto wrap = [](int i, int n) { return ((i % n) + n) % n; };
  const float x = (place.u - std::floor(place.u)) * float(texture.width()) - 0.5F;
  const float y = (1 - (place.v - std::floor(place.v))) * float(texture.height()) - 0.5F;
  const float left = std::floor(x), top = std::floor(y);
  const int x0 = wrap(int(left), texture.width()), x1 = wrap(int(left) + 1, texture.width());
  const int y0 = wrap(int(top), texture.height()), y1 = wrap(int(top) + 1, texture.height());
  const auto texel = [&](int row, int column) {
    const float* p = texture.pixel(row, column);
    return Vec3f(p[0], p[1], p[2]);
  };
  const Vec3f above = lerp(texel(y0, x0), texel(y0, x1), x - left);
  const Vec3f below = lerp(texel(y1, x0), texel(y1, x1), x - left);
  return lerp(above, below, y - top);
}

core::Image read_texture(const TextureSource& source, const fs::path& mesh_path) {
  if (!source.file.empty()) {
    const std::string place = mesh_path.string() + ": its texture";
    return core::to_rgb(core::read_image(core::path_inside(mesh_path.parent_path(), source.file, place)));
  }
  // The format is the file's word, and becomes part of a path.
  const auto is_letter = [](unsigned char c) { return std::isalnum(c) != 0; };
  if (source.format.empty() || !std::all_of(source.format.begin(), source.format.end(), is_letter)) {
    throw core::BadInput(mesh_path.string() + ": does not say of what format its texture is");
  }
  const TemporaryFile file(source.bytes, source.format);
  return core::to_rgb(core::read_image(file.path()));
}

}  // namespace lightstage::sim
