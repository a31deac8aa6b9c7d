#include "core/olat_scan.h"

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <random>
#include <thread>

#include "core/display.h"
#include "core/error.h"
#include "core/failure.h"
#include "core/parallel.h"
#include "core/sphere.h"

using namespace lightstage;
using core::Image;
using core::ImageSize;
using core::OlatScan;

namespace {

std::vector<core::Light> lights(std::size_t n) {
  std::vector<core::Light> result;
  for (const core::Direction& d : core::fibonacci_directions(n)) result.push_back({d, {}, {1, 1, 1}});
  return result;
}

Image picture(std::size_t light, ImageSize size) {
  Image image(size);
  std::mt19937 generator(static_cast<unsigned>(light));
  for (float& v : image.values()) v = float(generator() >> 8) * 0x1p-24f * float(light + 1);
  return image;
}

constexpr ImageSize kSize{13, 17, 3};
constexpr std::size_t kBytes = 13 * 17 * 3 * sizeof(float);

// A scan that counts how often each light's image was loaded.
struct Counted {
  explicit Counted(std::size_t n, std::size_t cache_bytes = std::size_t(1) << 30)
      : loads(std::make_shared<std::vector<std::atomic<int>>>(n)),
        scan(
            "s", lights(n), kSize, {},
            [counts = loads](std::size_t i) {
              ++(*counts)[i];
              return picture(i, kSize);
            },
            cache_bytes) {}
  std::vector<int> counts() const { return {loads->begin(), loads->end()}; }
  std::shared_ptr<std::vector<std::atomic<int>>> loads;
  OlatScan scan;
};

double slow_exposure(const OlatScan& scan) {
  std::vector<float> values;
  for (std::size_t i = 0; i < scan.light_count(); ++i) {
    const auto image = scan.image(i);
    for (int y = 0; y < image->height(); ++y)
      for (int x = 0; x < image->width(); ++x)
        for (int c = 0; c < image->channels(); ++c)
          if (scan.mask()(y, x) == 1) values.push_back((*image)(y, x, c));
  }
  return core::quantile(values, 0.995);
}

}  // namespace

TEST_CASE("a scan without a mask is all subject") {
  const Counted s(5);
  CHECK(s.scan.light_count() == 5);
  CHECK(s.scan.directions().size() == 5);
  CHECK(s.scan.light(3).direction == s.scan.directions()[3]);
  CHECK(s.scan.masked_pixel_count() == 13 * 17);
  CHECK(s.scan.mask().size() == ImageSize{13, 17, 1});
  CHECK(*s.scan.image(2) == picture(2, kSize));
  CHECK(s.counts() == std::vector<int>{0, 0, 1, 0, 0});
}

TEST_CASE("impossible scans and lights are refused") {
  const auto loader = [](std::size_t i) { return picture(i, kSize); };
  CHECK_THROWS_AS(OlatScan("s", {}, kSize, {}, loader), core::BadInput);
  CHECK_THROWS_AS(OlatScan("s", lights(2), {0, 0, 3}, {}, loader), core::BadInput);
  CHECK_THROWS_AS(OlatScan("s", lights(2), kSize, Image(13, 16, 1), loader), core::BadInput);
  CHECK_THROWS_AS(OlatScan("s", lights(2), kSize, Image(13, 17, 3), loader), core::BadInput);
  CHECK_THROWS_AS(OlatScan("s", lights(2), kSize, Image(13, 17, 1), loader),
                  core::BadInput);  // nothing inside
  const OlatScan scan("named", lights(2), kSize, {}, loader);
  CHECK(test::says(test::failure_of<core::BadInput>([&] { scan.image(2); }), "named", "not 2"));
  CHECK_THROWS_AS(scan.light(2), core::BadInput);
  CHECK_THROWS_AS(scan.with_lights(std::vector<std::size_t>{0, 2}), core::BadInput);
  CHECK_THROWS_AS(scan.with_lights({}), core::BadInput);
}

TEST_CASE("an image of another size is refused each time it is asked for") {
  const OlatScan scan("s", lights(2), kSize, {}, [](std::size_t) { return Image(13, 16, 3); });
  for (int i = 0; i < 2; ++i)
    CHECK(test::says(test::failure_of<core::BadInput>([&] { scan.image(1); }), "light 1", "16x13x3", "17x13x3"));
}

TEST_CASE("what a loader throws reaches the caller, and the next try loads again") {
  std::atomic<int> tries{0};
  const OlatScan scan("s", lights(2), kSize, {}, [&](std::size_t i) {
    if (++tries == 1) throw core::StoreError("disk unplugged");
    return picture(i, kSize);
  });
  CHECK_THROWS_AS(scan.image(0), core::StoreError);
  CHECK(*scan.image(0) == picture(0, kSize));
  CHECK(tries == 2);
}

TEST_CASE("the least recently used image goes first, and images in use stay valid") {
  const Counted s(4, 2 * kBytes);
  const auto zero = s.scan.image(0);
  s.scan.image(1);
  s.scan.image(0);  // 1 is now the oldest
  s.scan.image(2);  // drops 1
  s.scan.image(0);
  CHECK(s.counts() == std::vector<int>{1, 1, 1, 0});
  s.scan.image(1);  // drops 2
  s.scan.image(3);  // drops 0
  s.scan.image(0);
  CHECK(s.counts() == std::vector<int>{2, 2, 1, 1});
  CHECK(*zero == picture(0, kSize));
}

TEST_CASE("a cache too small for one image still serves images") {
  const Counted s(2, kBytes - 1);
  CHECK(*s.scan.image(1) == picture(1, kSize));
  CHECK(*s.scan.image(1) == picture(1, kSize));
  CHECK(s.counts() == std::vector<int>{0, 2});
}

TEST_CASE("threads that ask for one image at a time share one load") {
  std::atomic<int> loads{0};
  const OlatScan scan("s", lights(3), kSize, {}, [&](std::size_t i) {
    ++loads;
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    return picture(i, kSize);
  });
  std::vector<std::thread> threads;
  std::atomic<int> right{0};
  for (int t = 0; t < 8; ++t) threads.emplace_back([&] { right += *scan.image(1) == picture(1, kSize) ? 1 : 0; });
  for (std::thread& t : threads) t.join();
  CHECK(right == 8);
  CHECK(loads == 1);
}

TEST_CASE("a loader may use threads itself while others wait for its image") {
  core::set_thread_count(4);
  const OlatScan scan(
      "s", lights(3), kSize, {},
      [&](std::size_t i) {
        Image image = picture(i, kSize);
        core::parallel_for(
            64, 1, [](std::size_t, std::size_t) { std::this_thread::sleep_for(std::chrono::microseconds(200)); });
        return image;
      },
      kBytes);
  // Every range asks for the same few images: a thread inside a load must not be handed work that waits for
  // that load.
  std::atomic<int> right{0};
  core::parallel_for(200, 1, [&](std::size_t i, std::size_t) { right += scan.image(i % 3)->size() == kSize ? 1 : 0; });
  CHECK(right == 200);
  core::set_thread_count(0);
}

TEST_CASE("random use from many threads always gives the right image") {
  const Counted s(20, 5 * kBytes);
  std::vector<Image> expected;
  for (std::size_t i = 0; i < 20; ++i) expected.push_back(picture(i, kSize));
  std::vector<std::thread> threads;
  std::atomic<int> wrong{0};
  for (unsigned t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      std::mt19937 generator(t);
      for (int n = 0; n < 500; ++n) {
        const std::size_t i = generator() % 20;
        if (!(*s.scan.image(i) == expected[i])) ++wrong;
      }
    });
  for (std::thread& t : threads) t.join();
  CHECK(wrong == 0);
}

TEST_CASE("a scan with a cache of its own shares all but images") {
  const Counted s(4);
  const OlatScan uncached = s.scan.with_cache(0), small = s.scan.with_cache(2 * kBytes);
  for (int i = 0; i < 2; ++i) {
    CHECK(*uncached.image(1) == picture(1, kSize));
    CHECK(*small.image(2) == picture(2, kSize));
    CHECK(*s.scan.image(3) == picture(3, kSize));
  }
  CHECK(s.counts() == std::vector<int>{0, 2, 1, 1});
  CHECK(uncached.exposure() == slow_exposure(s.scan));
  const std::vector<int> counts = s.counts();
  CHECK(small.exposure() == uncached.exposure());
  CHECK(s.scan.exposure() == uncached.exposure());
  CHECK(s.counts() == counts);
  CHECK(small.with_lights(std::vector<std::size_t>{3, 0}).exposure() == uncached.exposure());
}

TEST_CASE("display-encoded images are made once for all copies of a scan, which give the others up") {
  const Counted s(4);
  const double exposure = s.scan.exposure();
  const auto expected = [&](std::size_t i) {
    Image image = picture(i, kSize);
    for (float& v : image.values()) v = core::display_encode(static_cast<float>(v / exposure));
    return image;
  };
  const std::vector<int> read = s.counts();
  {
    const OlatScan encoded = s.scan.display_encoded();
    CHECK(encoded.exposure() == 1);
    CHECK(encoded.directions() == s.scan.directions());
    CHECK(encoded.masked_pixel_count() == s.scan.masked_pixel_count());
    CHECK(*encoded.image(2) == expected(2));
    CHECK(s.counts() == read);  // what was cached is taken over
    const std::vector<std::size_t> chosen{3, 2};
    const OlatScan fewer = s.scan.with_lights(chosen).display_encoded();
    CHECK(fewer.image(1) == encoded.image(2));
    CHECK(fewer.image(0) == encoded.with_lights(chosen).image(0));
    CHECK(*s.scan.image(2) == picture(2, kSize));  // read again
    CHECK(s.counts()[2] == read[2] + 1);
    CHECK(*encoded.image(2) == expected(2));
    CHECK(s.counts()[2] == read[2] + 1);
  }
  CHECK(*s.scan.display_encoded().image(2) == expected(2));  // made anew: nobody held it
}

TEST_CASE("display-encoded images take no more memory than the scan's own may") {
  const Counted s(4, 2 * kBytes);
  CHECK(s.scan.images_kept() == 2);
  const OlatScan encoded = s.scan.display_encoded();
  CHECK(encoded.images_kept() == 2);
  for (std::size_t i = 0; i < 4; ++i) encoded.image(i);
  const std::vector<int> read = s.counts();
  encoded.image(3);
  encoded.image(2);
  CHECK(s.counts() == read);
  encoded.image(0);
  CHECK(s.counts()[0] == read[0] + 1);
}

TEST_CASE("exposure holds no more images at a time than may be cached") {
  core::set_thread_count(4);
  for (const std::size_t most : {0, 1, 2, 100}) {
    std::atomic<int> held = 0, highest = 0;
    const OlatScan scan(
        "s", lights(12), kSize, {},
        [&](std::size_t i) {
          const int now = ++held;
          for (int seen = highest; now > seen && !highest.compare_exchange_weak(seen, now);) {
          }
          std::this_thread::sleep_for(std::chrono::milliseconds(5));
          --held;
          return picture(i, kSize);
        },
        most * kBytes);
    CHECK(scan.exposure() > 0);
    CHECK(highest <= std::max(1, int(std::min<std::size_t>(most, 4))));
  }
  core::set_thread_count(0);
}

TEST_CASE("exposure is the exact 99.5th percentile inside the mask, at every thread count and cache size") {
  Image mask(13, 17, 1);
  for (std::size_t i = 0; i < mask.values().size(); ++i) mask.values()[i] = i % 3 == 0 ? 1.0f : 0.0f;
  for (const std::size_t n : {1U, 2U, 37U})
    for (const int threads : {1, 2, 5})
      for (const std::size_t cache : {std::size_t(0), std::size_t(1) << 30}) {
        core::set_thread_count(threads);
        const OlatScan scan(
            "s", lights(n), kSize, mask, [](std::size_t i) { return picture(i, kSize); }, cache);
        CHECK(scan.exposure() == slow_exposure(scan));
      }
  core::set_thread_count(0);
}

TEST_CASE("exposure stays exact when far more values pass by than are kept") {
  const ImageSize size{300, 310, 3};
  const OlatScan scan("s", lights(9), size, {}, [&](std::size_t i) { return picture((i * 5) % 9, size); });
  CHECK(scan.exposure() == slow_exposure(scan));
}

TEST_CASE("exposure is positive for black, nearly black, constant and negative scans") {
  const auto exposure_of = [](float background, float hot) {
    return OlatScan("s", lights(3), kSize, {},
                    [=](std::size_t i) {
                      Image image(kSize);
                      std::fill(image.values().begin(), image.values().end(), background);
                      if (i == 1) image(4, 4, 1) = hot;
                      return image;
                    })
        .exposure();
  };
  CHECK(exposure_of(0, 0) == 1);
  CHECK(exposure_of(0, 1e5f) == 1e5);  // fewer than 0.5% of values lit: the largest
  CHECK(exposure_of(0.25f, 1e5f) == 0.25);
  CHECK(exposure_of(-1, -1) == 1);
  CHECK(exposure_of(-1, 2) == 2);
  CHECK(exposure_of(1e-42f, 1e-42f) == double(1e-42f));
  const OlatScan one_pixel("s", lights(1), {1, 1, 1}, {}, [](std::size_t) {
    Image i(1, 1, 1);
    i(0, 0) = 3;
    return i;
  });
  CHECK(one_pixel.exposure() == 3);
}

TEST_CASE("a choice of lights shares images and exposure with the whole scan") {
  const Counted s(6);
  const std::vector<std::size_t> picks{4, 1, 4};
  const OlatScan some = s.scan.with_lights(picks);
  CHECK(some.light_count() == 3);
  CHECK(some.directions()[0] == s.scan.directions()[4]);
  CHECK(some.light(1).direction == s.scan.light(1).direction);
  CHECK(*some.image(0) == picture(4, kSize));
  CHECK(some.image(2) == s.scan.image(4));  // the same object
  const OlatScan again = some.with_lights(std::vector<std::size_t>{1});
  CHECK(*again.image(0) == picture(1, kSize));
  CHECK(again.exposure() == slow_exposure(s.scan));
  CHECK(s.scan.exposure() == again.exposure());
  CHECK(s.counts() == std::vector<int>{1, 1, 1, 1, 1, 1});  // and computed once
}
