// The light check: run before a pass, so that trouble is known before the subject sits.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "capture/sequence.h"
#include "capture/session.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::capture {

// What one camera saw. Pictures are small (no side longer than kCheckPictureSide, area means), of one channel (the
// mean of the camera's: a light may have any colour), in radiance.
struct CameraPictures {
  std::string camera;
  std::vector<core::Image> of_light;  // less the mean dark picture; empty where no frame showed the light
  std::vector<core::Image> dark;      // less their mean: noise, and whatever else changed during the check
};
constexpr int kCheckPictureSide = 32;

// Every light once in the order of its index, dark frames before, after and in between (one before every 20th light, three at
// the start and one at the end), all of one exposure; in lockstep unless the caller changes it. n + n / 20 + 4 frames: 10 s for
// 180 lights at 20 frames a second. Throws UsageError as make_olat_sequence.
Sequence make_light_check_sequence(std::size_t light_count, core::Nanoseconds exposure);

// Runs the sequence (dry_run: nothing is stored) and keeps the small pictures of its single lights and dark frames: 4 kB a
// light and camera. options.on_frame is called too. Throws as dry_run; UsageError where the sequence has no dark frame.
std::vector<CameraPictures> take_light_pictures(const Sequence& sequence, const Rig& rig,
                                                const SessionOptions& options = {});

enum class LightTrouble {
  kDead,     // no camera sees it where its neighbours predict light
  kWeak,     // far darker than they predict
  kSwapped,  // shows another light's place: light i that of others[0], which shows that of others[1], ... back to i
  kDouble,   // with it others[0] is lit too, or instead, though that one's own output lights it as well
};

struct LightFinding {
  LightTrouble trouble = LightTrouble::kDead;
  int light = 0;            // counts from 0
  std::vector<int> others;  // kSwapped and kDouble
  std::string text;         // one line for the operator, with the numbers it rests on
};

struct LightCheckReport {
  std::vector<LightFinding> findings;  // in order of light; a cycle of swapped lights is one finding, at its first
  // Lights of which the pictures say nothing: no camera sees them, and their neighbours do not agree on what should
  // be seen (behind the subject), or they have no picture.
  std::vector<int> unjudged;
  // Why nothing, or not everything, could be judged; empty where it could. Then `findings` may be incomplete.
  std::string too_little;
};

// Judges pictures of all lights by what their neighbours on the sphere predict. Names nothing on a guess: with fewer than 16
// lights, fewer than 2 dark frames or suspects among a quarter of the lights `too_little` says so. Where lights
// hang is all that is used of the stage; the subject may be any, and may move as one does who tries to sit still.
//
// Method. A picture under one light is additive and, but for cast shadows, changes smoothly with the light's direction: the 6
// nearest lights predict it by a linear fit over the tangent plane. Pictures are weighted so that bright parts do not drown
// the rest (shot noise has the same weights), and compared by the sine of the angle between them as vectors, the misfit,
// which no light's gain changes. A misfit by itself says little: at the front neighbours predict to 0.1, at grazing
// light not at all (0.9). So misfits are compared with one another:
//   swapped  two pictures that both fit better in each other's place (ratio of geometric means above kPairRatio), or one that
//            fits far better in another place (kAloneRatio);
//   double   the picture without light j's picture fits far better (kDoubleRatio), or it is light j's picture
//            (kSameRatio) while that fits better where it is;
//   dead     a picture like the dark ones where the prediction is a fifth of the usual brightness at least and the
//            neighbours are predicted themselves by those around (behind the subject each shows another rim: unjudged);
//   weak     right in shape, with a level farther below 1 than 5 robust standard deviations of all levels and 1.5 times the
//            misfit explain.
// and only a picture that fits worse in its own place than its neighbours do in theirs is suspected of any of these. The
// plainest is named first and taken from the predictions, until nothing is found: a light at fault does not spoil the
// judgement of its neighbours. The bounds stand clear of what sound stages show; light_check_test.cpp measures both sides.
//
// Limits: a whole board of lights exchanged with another one shows only at its edge. Troubles among lights next to each
// other and at grazing light are found less often: the test prints how often, by distance. Saturated pictures and ambient light that changes during the check weaken it.
//
// O(n^2) in the number of lights (n^2 pixels * cameras multiplications: 0.1 s for 180 lights). Throws BadInput where
// pictures and positions do not belong together, and for a light at the centre.
LightCheckReport check_lights(std::span<const core::Vec3> light_positions, std::span<const CameraPictures> cameras);

}  // namespace lightstage::capture
