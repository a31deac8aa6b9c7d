// Everything that decides what a simulated capture looks like, as data: kept in a scan's provenance, so that truth can be
// rendered later.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "capture/stage.h"
#include "core/clock.h"
#include "core/vec3.h"

namespace lightstage::sim {

enum class SubjectKind { kProceduralHead, kMesh, kMirrorBall, kGreyBall, kChessboard, kWhiteCard };

struct SubjectSpec {
  SubjectKind kind = SubjectKind::kProceduralHead;
  std::uint64_t seed = 1;  // shape, albedo and gloss of the procedural head; gloss of a mesh
  std::string mesh_path;   // absolute; for kMesh
  std::string mesh_hash;   // of the file's bytes, hexadecimal; checked when truth is rendered again
  double size_m = 0;    // radius of a ball, height of anything else (of a chessboard's squares); 0: what suits the kind
  double albedo = 0.5;  // of the grey ball
  double yaw_degrees = 0;  // turned about y before it is placed
  core::Vec3 position;     // metres from stage centre, where it stands
};

// Balls do not move. A chessboard is held in another pose every second (sim/held_board.h), unless amplitude_m is 0: then it stands still.
struct MotionSpec {
  double amplitude_m = 0.004;  // of the drift of the subject over the pass; 0 for a subject that stands still
  double rotation_degrees = 0.6;
};

struct SensorSpec {
  bool noise = true;  // shot noise, read noise and 12-bit quantisation
  double full_well_electrons = 10500;
  double read_noise_electrons = 2.5;
  int bits = 12;
  double vignetting = 0.15;  // relative loss of light in the image corner
  bool bayer = false;        // RGGB mosaic, demosaiced by the simulated driver
};

// Faults are counted in events, never in time, so that a run can be repeated exactly.
struct FaultSpec {
  std::vector<int> drop_exposures;            // the n-th exposures (from 0) whose frame is lost
  std::vector<int> duplicate_exposures;       // delivered twice
  std::vector<int> damage_exposures;          // delivered with the damaged flag and half the picture missing
  std::vector<int> light_timeouts;            // the n-th LedController::show calls that time out
  double drop_probability = 0;                // of any frame
  core::Nanoseconds rise_time = 300'000;      // LEDs reach 63 % of their level after this
  core::Nanoseconds trigger_jitter = 50'000;  // standard deviation of the start of exposure
};

struct Simulation {
  capture::Stage stage;
  SubjectSpec subject;
  MotionSpec motion;
  SensorSpec sensor;
  FaultSpec faults;
  bool indirect_bounce = false;  // one bounce of diffuse light
  int pixel_samples = 4;         // rays a pixel, a square number from 1 to 256: 4 is a 2x2 grid
  std::uint64_t seed = 1;        // noise, motion, jitter, faults
};

// JSON, complete and stable. Reading throws BadInput naming the key that is missing, of the wrong type, or not known.
std::string to_json(const Simulation& simulation);
Simulation simulation_from_json(std::string_view json);

// The subject's natural size in metres where size_m is 0.
double subject_size_m(const SubjectSpec& subject);

}  // namespace lightstage::sim
