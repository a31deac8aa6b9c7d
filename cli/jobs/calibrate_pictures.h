// Lights from loose pictures of balls, without a store.
#pragma once

#include "cli/jobs/ball_pictures.h"
#include "cli/jobs/join_lights.h"

namespace lightstage::cli {

struct PicturesReport : LightsReport {  // a light's index is its picture's place in BallPictures::names
  double seconds = 0;
};

// Highlights in every view (calib/mirror_ball.h), joined as by join_lights. A light is named "dead" when its pictures hold no more light than a
// hundredth of what the other lights' hold, "hidden" when they are lit but no ball shows it.
PicturesReport calibrate_pictures(const BallPictures& pictures);

}  // namespace lightstage::cli
