// What OpenEXR's lossless compressions take and save for a camera's frame: 1920x1080, one channel, a head under one light with shot and read
// noise, quantised to 16 bits. `plain` is the store's own way to write frames (core/image_file.h, WriteOptions::compressed).
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <benchmark/benchmark.h>

#include "capture/stage.h"
#include "core/image_file.h"
#include "sim/sensor.h"
#include "sim/world.h"

using namespace lightstage;

namespace {

const core::Image& frame() {
  static const core::Image image = [] {
    capture::LayoutOptions layout;
    layout.lights = 32;
    layout.camera_pixels = 1080;
    sim::Simulation simulation;
    simulation.stage = capture::make_stage("bench", layout);
    core::CameraModel& camera = simulation.stage.cameras[0].model;
    camera.width = 1920;
    camera.cx += (1920 - 1080) / 2.0;
    simulation.motion.amplitude_m = 0;
    simulation.pixel_samples = 1;
    simulation.sensor.bits = 16;
    const sim::World world(simulation);
    const std::vector<capture::LightLevel> lit{{3}};
    return sim::sense(core::to_luminance(world.render(camera, lit, 0)), simulation.sensor,
                      simulation.stage.cameras[0].responsivity, 20 * core::kMillisecond, 1);
  }();
  return image;
}

std::size_t raw_bytes() {
  return 2 * frame().values().size();
}

void report(benchmark::State& state, std::size_t file_bytes) {
  state.SetBytesProcessed(std::int64_t(state.iterations()) * std::int64_t(raw_bytes()));
  state.counters["raw_over_file"] = double(raw_bytes()) / double(file_bytes);
}

void compressed_by_library(benchmark::State& state, const char* compression) {
  std::size_t size = 0;
  for (auto _ : state) {
    std::vector<unsigned char> bytes;
    OIIO::Filesystem::IOVecOutput sink(bytes);
    const auto output = OIIO::ImageOutput::create("openexr");
    OIIO::ImageSpec spec(frame().width(), frame().height(), 1, OIIO::TypeDesc::HALF);
    spec.attribute("Compression", compression);
    output->set_ioproxy(&sink);
    if (!output->open("frame.exr", spec) || !output->write_image(OIIO::TypeDesc::FLOAT, frame().values().data()) ||
        !output->close()) {
      state.SkipWithError(output->geterror().c_str());
    }
    size = bytes.size();
  }
  report(state, std::max<std::size_t>(1, size));
}

void plain(benchmark::State& state) {
  std::size_t size = 0;
  for (auto _ : state) size = core::encode_image("frame.exr", frame(), {.compressed = false}).size();
  report(state, size);
}

}  // namespace

BENCHMARK(plain)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compressed_by_library, none, "none")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compressed_by_library, rle, "rle")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compressed_by_library, zips, "zips")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compressed_by_library, zip, "zip")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compressed_by_library, zip_level_1, "zip:1")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compressed_by_library, piz, "piz")->Unit(benchmark::kMillisecond);

BENCHMARK_MAIN();
