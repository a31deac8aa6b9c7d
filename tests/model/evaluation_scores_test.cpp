// What a method's score says beside its means: errors by angle, memory, fronts, and stages with fewer lights.
#include <catch2/catch.hpp>
#include <set>

#include "core/error.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/evaluation.h"
#include "model/metrics.h"
#include "model/pareto_front.h"
#include "model/peak_memory.h"
#include "model/synthetic_scan.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using model::CostAndError;

constexpr core::ImageSize kSize{24, 24, 3};

model::InterpolatorFactory nearest() {
  return [](const core::OlatScan& scan) { return model::make_nearest(scan); };
}

Direction turned(double degrees) {
  return Direction::from_vector(
      {std::sin(core::radians_from_degrees(degrees)), 0, std::cos(core::radians_from_degrees(degrees))});
}

}  // namespace

TEST_CASE("bins by angle hold the images whose nearest light is so far, and add up to the whole") {
  const std::vector<Direction> lights{turned(0), turned(90)};
  const core::OlatScan scan = test::scan_of(lights, kSize, test::matt_ball(kSize));
  std::vector<Direction> queries;
  for (const double degrees : {0.0, 1.0, 1.6, 14.0, 30.0, 80.0, 91.0}) queries.push_back(turned(degrees));
  const auto scores = model::evaluate_against_truth(scan, std::vector{nearest()}, queries, [&](std::size_t i) {
    return test::picture_of(kSize, queries[i], test::matt_ball(kSize));
  });
  const auto& bins = scores.at(0).by_angle;
  REQUIRE(bins.size() == 11);
  CHECK(bins[0].images == 3);  // 0, 1 and 91
  CHECK(bins[1].images == 1);
  CHECK(bins[6].images == 1);   // 10 from the second light
  CHECK(bins[9].images == 1);   // 14
  CHECK(bins[10].images == 1);  // 30
  CHECK(bins[10].from_deg == 15);
  CHECK(bins[10].to_deg == 180);
  CHECK_FALSE(bins[2].rmse);
  double squares = 0, dssim = 0;
  std::size_t images = 0;
  for (std::size_t i = 0; i < bins.size(); ++i) {
    if (i > 0) CHECK(bins[i].from_deg == bins[i - 1].to_deg);
    images += bins[i].images;
    if (bins[i].images == 0) continue;
    squares += double(bins[i].images) * *bins[i].rmse * *bins[i].rmse;
    dssim += double(bins[i].images) * *bins[i].dssim;
  }
  CHECK(images == scores[0].images);
  CHECK(std::sqrt(squares / double(images)) == Approx(scores[0].rmse));
  CHECK(dssim / double(images) == Approx(scores[0].dssim));
  CHECK(*bins[10].rmse > 2 * *bins[0].rmse);  // nearest is worse farther away
  REQUIRE(scores[0].each.size() == 7);
  CHECK(scores[0].each[3].degrees_to_light == Approx(14));
  CHECK(scores[0].each[3].index == 3);
}

TEST_CASE("under held-out the angle is to the nearest light that is left, never 0") {
  const std::vector<Direction> lights = core::fibonacci_directions(60);
  const core::OlatScan scan = test::scan_of(lights, kSize, test::matt_ball(kSize));
  const auto scores = model::evaluate_held_out(scan, std::vector{nearest()}, 7);
  for (const model::ImageScore& image : scores.at(0).each) {
    const std::size_t other = core::nearest_indices(lights, lights[image.index], 2)[1];
    CHECK(image.degrees_to_light ==
          Approx(core::degrees_from_radians(core::angle_radians(lights[image.index], lights[other]))));
  }
  CHECK(scores[0].each.back().index == 56);
}

TEST_CASE("scores are means of the measures of model/metrics.h, with those asked for") {
  const std::vector<Direction> lights = core::fibonacci_directions(30);
  const core::OlatScan scan = test::scan_of(lights, kSize, test::matt_ball(kSize));
  const std::vector<Direction> queries{turned(20), turned(70)};
  const auto truth = [&](std::size_t i) { return test::picture_of(kSize, queries[i], test::matt_ball(kSize)); };
  const model::EvaluationOptions options{.hdr_flip = true,
                                         .own_metric = [](core::ImageView a, core::ImageView b, core::ImageView) {
                                           return double(a(12, 12, 0)) - 2 * double(b(12, 12, 0));
                                         }};
  const auto score = model::evaluate_against_truth(scan, std::vector{nearest()}, queries, truth, options).at(0);
  double msssim = 0, gmsd = 0, hdr_flip = 0, own = 0;
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const Image picture = model::make_nearest(scan)->render(queries[i]);
    const Image a = model::judged(truth(i), scan.exposure(), false), b = model::judged(picture, scan.exposure(), false);
    msssim += model::ms_ssim(a, b, scan.mask()) / 2;
    gmsd += model::gmsd(a, b, scan.mask()) / 2;
    hdr_flip += model::hdr_flip(truth(i), picture, scan.mask()) / 2;
    own += (double(a(12, 12, 0)) - 2 * double(b(12, 12, 0))) / 2;
  }
  CHECK(score.msssim == Approx(msssim));
  CHECK(score.msssim < 1);
  CHECK(score.gmsd == Approx(gmsd));
  CHECK(score.gmsd > 0);
  CHECK(score.hdr_flip.value() == Approx(hdr_flip));
  CHECK(score.own_error.value() == Approx(own));
  const auto plain = model::evaluate_against_truth(scan, std::vector{nearest()}, queries, truth).at(0);
  CHECK_FALSE(plain.hdr_flip);
  CHECK_FALSE(plain.own_error);
  CHECK(plain.gmsd == score.gmsd);
}

TEST_CASE("the peak of memory is counted anew and sees what was held for a while") {
#ifdef __SANITIZE_ADDRESS__
  SKIP_TEST("AddressSanitizer keeps memory that was given back");
#endif
  const model::PeakMemory before;
  if (!before.bytes()) SKIP_TEST("this system does not let a process count anew");
  constexpr std::size_t kBytes = std::size_t(200) << 20;
  {
    std::vector<char> held(kBytes, 'x');
    REQUIRE(held[kBytes / 2] == 'x');
  }
  const std::size_t with = *before.bytes();
  const model::PeakMemory after;
  CHECK(with > *after.bytes() + kBytes * 9 / 10);
}

TEST_CASE("the front holds what nothing else beats, and only that") {
  const std::vector<CostAndError> points{{1, 5}, {2, 3}, {2, 4}, {3, 3}, {4, 1}, {4, 1}, {5, NAN}, {NAN, 0}, {9, 0.5}};
  const std::vector<bool> front = model::pareto_front(points);
  CHECK(front == std::vector<bool>{true, true, false, false, true, true, false, false, true});
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = 0; j < points.size(); ++j)
      if (front[i] && front[j]) CHECK_FALSE((points[j].cost < points[i].cost && points[j].error < points[i].error));
  CHECK(model::pareto_front({}).empty());
}

TEST_CASE("fewer lights are spread better than every n-th, and are the first of more") {
  const std::vector<Direction> lights = core::random_directions(200, 3);
  const auto smallest_gap = [&](const std::vector<std::size_t>& chosen) {
    double smallest = 4;
    for (std::size_t i = 0; i < chosen.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        smallest = std::min(smallest, core::angle_radians(lights[chosen[i]], lights[chosen[j]]));
    return smallest;
  };
  const std::vector<std::size_t> fifty = model::well_spread(lights, 50), hundred = model::well_spread(lights, 100);
  std::vector<std::size_t> every_fourth;
  for (std::size_t i = 0; i < 200; i += 4) every_fourth.push_back(i);
  REQUIRE(fifty.size() == 50);
  CHECK(std::is_sorted(fifty.begin(), fifty.end()));
  CHECK(std::set<std::size_t>(fifty.begin(), fifty.end()).size() == 50);
  CHECK(std::includes(hundred.begin(), hundred.end(), fifty.begin(), fifty.end()));
  CHECK(smallest_gap(fifty) > 3 * smallest_gap(every_fourth));
  // No hole is wider than the smallest gap: else a light in it would have been chosen.
  for (const Direction& light : lights) {
    double nearest = 4;
    for (const std::size_t i : fifty) nearest = std::min(nearest, core::angle_radians(lights[i], light));
    CHECK(nearest <= smallest_gap(fifty) + 1e-12);
  }
  CHECK(model::well_spread(lights, 1000).size() == 200);
  CHECK(model::well_spread(std::vector<Direction>(5), 3).size() == 3);  // duplicates
  CHECK_THROWS_AS(model::well_spread(lights, 0), core::UsageError);
}

TEST_CASE("stages thinned as published blend as many neighbours as published") {
  const std::vector<int> published{8, 7, 6, 5, 4};
  int i = 0;
  for (const std::size_t n : {302, 250, 200, 150, 100})
    CHECK(model::published_neighbours(n) == published[std::size_t(i++)]);
  CHECK(model::published_neighbours(1) == 4);
  CHECK(model::published_neighbours(100000) == 8);
}

}  // namespace lightstage
