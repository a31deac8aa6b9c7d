// A look at the header of an OpenEXR file before the library opens it: opening takes memory for what the header claims.
#pragma once

#include <cstdint>
#include <filesystem>

namespace lightstage::core::image_io {

// Throws BadInput for a header that is cut short, that has attributes larger than the file or of another size than their type has, or pictures or tiles of more than
// `max_values` pixels or more than a file of that size could hold ("OpenEXR File Layout", openexr.com; all parts are looked at). Leaves everything else to the library.
void check_exr_header(const std::filesystem::path& path, std::uint64_t max_values, std::uint64_t most_compression);

}  // namespace lightstage::core::image_io
