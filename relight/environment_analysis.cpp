#include "relight/environment_analysis.h"

#include <algorithm>
#include <numeric>

#include "relight/harmonics.h"

namespace lightstage::relight {

namespace {

constexpr int kDegree = 50;
constexpr double kShare = 0.9;
constexpr int kLinearSuffices = 15, kSuperResolutionPays = 20;

double squared_integral(const Environment& map) {
  double sum = 0;
  for (int y = 0; y < map.height(); ++y) {
    double row = 0;
    const float* p = map.radiance().pixel(y, 0);
    for (std::ptrdiff_t i = 0; i < 3 * std::ptrdiff_t(map.width()); ++i) row += double(p[i]) * double(p[i]);
    sum += row * map.solid_angle(y);
  }
  return sum;
}

}  // namespace

std::string_view verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::kLinear:
      return "linear";
    case Verdict::kEither:
      return "either";
    case Verdict::kSuperResolution:
      break;
  }
  return "super_resolution";
}

int degree_holding(std::span<const double> energy_by_degree, double share) {
  const double enough = share * std::accumulate(energy_by_degree.begin(), energy_by_degree.end(), 0.0);
  double held = 0;
  for (std::size_t degree = 0; degree < energy_by_degree.size(); ++degree) {
    held += energy_by_degree[degree];
    if (held >= enough) return int(degree);
  }
  return std::max(0, int(energy_by_degree.size()) - 1);  // a share of 1, but for rounding
}

Verdict verdict_of(int degree_90) {
  if (degree_90 <= kLinearSuffices) return Verdict::kLinear;
  return degree_90 < kSuperResolutionPays ? Verdict::kEither : Verdict::kSuperResolution;
}

EnvironmentAnalysis analyse(const Environment& environment) {
  EnvironmentAnalysis analysis;
  analysis.energy_by_degree = Harmonics(environment.radiance(), kDegree).energy_by_degree();
  analysis.degree_90 = degree_holding(analysis.energy_by_degree, kShare);
  const double held = std::accumulate(analysis.energy_by_degree.begin(), analysis.energy_by_degree.end(), 0.0);
  const double all = squared_integral(environment);
  if (all > 0) analysis.share_above_50 = std::max(0.0, 1 - held / all);
  analysis.verdict = verdict_of(analysis.degree_90);
  analysis.small_sources = small_sources(environment);
  return analysis;
}

}  // namespace lightstage::relight
