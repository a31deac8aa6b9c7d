#include "sim/subjects/head_skin.h"

#include <algorithm>

namespace lightstage::sim {
namespace {

// Colours of a person, linear.
struct Palette {
  explicit Palette(std::uint64_t seed) {
    const auto u = [&](std::uint64_t i) { return float(uniform(mix(seed, 21), i)); };
    constexpr std::array<Vec3f, 4> kSkins{Vec3f(0.66F, 0.43F, 0.33F), Vec3f(0.52F, 0.31F, 0.21F),
                                          Vec3f(0.30F, 0.16F, 0.095F), Vec3f(0.13F, 0.065F, 0.04F)};
    const float tone = u(0) * 2.999F;
    const auto lighter = std::size_t(tone);
    skin = lerp(kSkins[lighter], kSkins[lighter + 1], tone - float(lighter));
    constexpr std::array<Vec3f, 5> kHairs{Vec3f(0.02F, 0.014F, 0.01F), Vec3f(0.06F, 0.033F, 0.017F),
                                          Vec3f(0.15F, 0.08F, 0.035F), Vec3f(0.38F, 0.25F, 0.11F),
                                          Vec3f(0.34F, 0.33F, 0.32F)};
    hair = tone > 1.2F ? kHairs[std::size_t(u(1) * 1.999F)] : kHairs[std::size_t(u(1) * 4.999F)];
    constexpr std::array<Vec3f, 4> kIrises{Vec3f(0.06F, 0.03F, 0.012F), Vec3f(0.10F, 0.16F, 0.22F),
                                           Vec3f(0.09F, 0.13F, 0.06F), Vec3f(0.16F, 0.09F, 0.03F)};
    iris = tone > 1.2F ? kIrises[0] : kIrises[std::size_t(u(2) * 3.999F)];
    freckles = tone < 1.0F ? u(3) : 0.3F * u(3);
    stubble = u(4) < 0.5F ? 0.0F : 0.25F + 0.5F * u(4);
    lip_redness = 0.3F + 0.5F * u(5);
    skin_alpha = 0.22F + 0.16F * u(6);
    skin_f0 = 0.028F + 0.01F * u(7);
  }

  Vec3f skin, hair, iris;
  float freckles, stubble, lip_redness, skin_alpha, skin_f0;
};

class HeadSkin : public Appearance {
 public:
  HeadSkin(const HeadShape& shape, HeadPlacement placement, std::uint64_t seed)
      : shape_(shape), placement_(placement), palette_(seed), noise_(mix(seed, 22)) {}

  void apply(const MeshPoint&, SurfaceSample& sample) const override {
    const Vec3f p = (sample.position - placement_.offset) * (1 / placement_.scale);
    const Vec3f q{std::abs(p.x), p.y, p.z};
    const Vec3f from_eye = q - shape_.eye_centre();
    if (norm(from_eye) < shape_.eye_radius() + 0.05F && from_eye.z > 0.2F) {
      paint_eye(from_eye, p, sample);
      return;
    }
    const float ear = smooth_step(0.3F, 0.1F, shape_.ear_distance(p));
    const float hair = smooth_step(-0.15F, 0.35F, shape_.hair_depth(p)) * (1 - ear);
    paint_skin(p, q, ear, sample);
    if (hair > 0) paint_hair(p, hair, sample);
  }

 private:
  void paint_eye(Vec3f from_eye, Vec3f p, SurfaceSample& sample) const {
    // Both eyes look at the primary camera, which is far away.
    const float off_axis = std::hypot(from_eye.x, from_eye.y) / shape_.eye_radius();
    const Vec3f white = Vec3f(0.52F, 0.48F, 0.45F) * (1 - 0.2F * smooth_step(0.6F, 1, off_axis));
    const float angle = std::atan2(from_eye.y, from_eye.x);
    const float fibres = 1 + 0.35F * noise_({angle * 6, off_axis * 5, p.x > 0 ? 3.0F : 8.0F});
    const Vec3f iris = palette_.iris * fibres * (1 - 0.6F * smooth_step(0.40F, 0.48F, off_axis));
    const float pupil = smooth_step(0.20F, 0.16F, off_axis);
    sample.albedo = lerp(iris, white, smooth_step(0.46F, 0.51F, off_axis)) * (1 - 0.95F * pupil);
    sample.alpha = 0.07F;
    sample.f0 = 0.035F;
  }

  void paint_skin(Vec3f p, Vec3f q, float ear, SurfaceSample& sample) const {
    const HeadTraits& t = shape_.traits();
    const float blotches = noise_.octaves(p * 0.55F, 3);
    const float pores = noise_(p * 5.3F) + 0.6F * noise_(p * 9.1F);
    Vec3f colour = palette_.skin * (1 + 0.10F * blotches + 0.05F * pores);

    // Blood shows in cheeks, nose and ears.
    const Vec3f mouth = shape_.mouth();
    const float cheek = std::exp(-0.25F * (dot(q - Vec3f(4.0F, -3.3F, 7.3F), q - Vec3f(4.0F, -3.3F, 7.3F))));
    const float nose = smooth_step(9.4F, 11.0F, p.z);
    const float flush = 0.25F * std::min(cheek + nose + 0.8F * ear, 1.0F) * (1 + 0.4F * blotches);
    colour = colour * Vec3f(1 + 0.25F * flush, 1 - 0.55F * flush, 1 - 0.5F * flush);

    // Freckles: where a noise peaks, mostly across cheeks and nose.
    const float where =
        palette_.freckles * std::exp(-0.06F * (p.y + 2.2F) * (p.y + 2.2F)) * smooth_step(3.5F, 6.0F, p.z);
    const float freckle = smooth_step(0.42F, 0.62F, noise_(p * 2.9F + Vec3f(40, 0, 0))) * where;
    colour = colour * lerp(Vec3f(1, 1, 1), Vec3f(0.62F, 0.48F, 0.40F), std::min(freckle * 1.2F, 1.0F));
    const float mole = smooth_step(0.88F, 0.92F, noise_(p * 1.9F + Vec3f(0, 70, 0)));
    colour = lerp(colour, palette_.skin * Vec3f(0.3F, 0.2F, 0.16F), 0.9F * mole);

    sample.alpha = palette_.skin_alpha * (1 + 0.15F * blotches - 0.25F * nose);
    sample.f0 = palette_.skin_f0;

    // Lips.
    const float wide = 2.5F * t.mouth_width;
    const float along = std::clamp(q.x / wide, 0.0F, 1.0F);
    const float upper = 0.86F * t.lip_fullness * (1 - along * along) + 0.10F * std::sin(std::min(q.x * 2.2F, 3.1F));
    const float lower = 1.06F * t.lip_fullness * (1 - along * along);
    const float height = p.y - mouth.y;
    const float beyond = height > 0 ? height - upper : -height - lower;
    const float lips =
        smooth_step(0.12F, -0.12F, beyond) * smooth_step(7.0F, 7.6F, p.z) * smooth_step(1.05F, 0.95F, q.x / wide);
    const Vec3f lip_colour =
        palette_.skin * Vec3f(0.85F, 0.85F - 0.55F * palette_.lip_redness, 0.85F - 0.45F * palette_.lip_redness);
    colour = lerp(colour, lip_colour * (1 + 0.12F * noise_(Vec3f(p.x * 6, p.y * 1.5F, 0))), 0.85F * lips);
    sample.alpha = sample.alpha * (1 - 0.35F * lips);

    // Stubble on jaw, chin and upper lip.
    const float jaw = smooth_step(-4.0F, -6.5F, p.y - 0.25F * q.x) * smooth_step(-0.5F, 2.5F, p.z) *
                      smooth_step(-13.0F, -11.0F, p.y) * (1 - lips);
    const float speckle = smooth_step(-0.3F, 0.6F, noise_(p * 6.5F + Vec3f(0, 0, 90)));
    colour = lerp(colour, palette_.hair * 1.5F, palette_.stubble * jaw * (0.25F + 0.55F * speckle));

    // Brows: a tapering arc of short hairs; lashes: a dark line along the lids.
    const float arch = 1.95F + 0.35F * std::sin((q.x - 0.8F) * 0.62F) - 0.05F * (q.x - 3) * (q.x - 3);
    const float thick = 0.42F * smooth_step(5.3F, 2.0F, q.x) * smooth_step(0.7F, 1.4F, q.x) + 0.03F;
    const float hairs = 0.75F + 0.45F * noise_(Vec3f((p.x * (p.x > 0 ? 1.0F : -1.0F) - 0.5F * p.y) * 5, p.y * 2, 0));
    const float brow = smooth_step(1.0F, 0.55F, std::abs(p.y - arch) / thick) * smooth_step(5.4F, 4.9F, q.x) *
                       smooth_step(0.7F, 1.2F, q.x) * smooth_step(4.0F, 5.0F, p.z);
    colour = lerp(colour, palette_.hair, std::clamp(brow * hairs, 0.0F, 1.0F) * 0.9F);
    const Vec3f from_eye = q - shape_.eye_centre();
    const float lid = norm(from_eye) - shape_.eye_radius();
    const float lashes = smooth_step(0.17F, 0.06F, lid) * smooth_step(0.1F, 0.6F, from_eye.z);
    colour = lerp(colour, palette_.hair * 0.6F, 0.85F * lashes);

    sample.albedo = {std::clamp(colour.x, 0.0F, 0.9F), std::clamp(colour.y, 0.0F, 0.9F),
                     std::clamp(colour.z, 0.0F, 0.9F)};
    bend(
        sample, [&](Vec3f d) { return 0.020F * noise_(d * 3.1F) + 0.009F * noise_(d * 6.7F); }, p, 0.06F);
  }

  void paint_hair(Vec3f p, float amount, SurfaceSample& sample) const {
    // Strands run back from the forehead and down at the sides.
    const Vec3f along{p.x * 3.2F + 0.8F * noise_(p * 0.4F), p.y * 0.8F, p.z * 0.55F};
    const float strands = noise_(along * 1.3F) + 0.6F * noise_(along * 3.1F);
    const Vec3f colour = palette_.hair * (1 + 0.55F * strands);
    sample.albedo =
        lerp(sample.albedo, Vec3f(std::max(colour.x, 0.003F), std::max(colour.y, 0.003F), std::max(colour.z, 0.003F)),
             amount);
    sample.alpha += (0.33F - sample.alpha) * amount;
    sample.f0 += (0.045F - sample.f0) * amount;
    bend(
        sample,
        [&](Vec3f d) {
          const Vec3f a{d.x * 3.2F, d.y * 0.8F, d.z * 0.55F};
          return 0.05F * amount * (noise_(a * 1.3F) + 0.5F * noise_(a * 3.1F));
        },
        p, 0.05F);
  }

  // Turns the normal as if the surface were raised by `height` (centimetres): n - tangential gradient.
  template <class Height>
  static void bend(SurfaceSample& sample, const Height& height, Vec3f p, float step) {
    const float here = height(p);
    const Vec3f slope = Vec3f(height(p + Vec3f(step, 0, 0)) - here, height(p + Vec3f(0, step, 0)) - here,
                              height(p + Vec3f(0, 0, step)) - here) *
                        (1 / step);
    const Vec3f tangential = slope - sample.normal * dot(slope, sample.normal);
    sample.normal = normalised(sample.normal - tangential);
  }

  HeadShape shape_;
  HeadPlacement placement_;
  Palette palette_;
  Noise noise_;
};

}  // namespace

std::unique_ptr<const Appearance> make_head_skin(const HeadShape& shape, HeadPlacement placement, std::uint64_t seed) {
  return std::make_unique<HeadSkin>(shape, placement, seed);
}

}  // namespace lightstage::sim
