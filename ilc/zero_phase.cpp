#include "ilc/zero_phase.h"

#include <algorithm>
#include <cassert>
#include <numbers>

namespace servotwin {

ZeroPhase::ZeroPhase(Eigen::Index samples, double h) : samples_(samples), padded_(4) {
  assert(samples > 0 && h > 0.0);
  while (padded_ < 2 * samples) padded_ *= 2;
  before_ = (padded_ - samples) / 2;
  omega_ = Eigen::ArrayXd::LinSpaced(padded_ / 2 + 1, 0.0, std::numbers::pi / h);
  fft_.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  time_.resize(static_cast<std::size_t>(padded_));
}

Eigen::ArrayXd ZeroPhase::filtered(const Eigen::ArrayXd& signal, const Eigen::ArrayXcd& response) {
  assert(signal.size() == samples_ && response.size() == omega_.size());
  const auto begin = time_.begin() + before_, end = begin + samples_;
  std::fill(time_.begin(), begin, signal(0));
  std::copy(signal.begin(), signal.end(), begin);
  std::fill(end, time_.end(), signal(samples_ - 1));
  fft_.fwd(spectrum_, time_);
  for (Eigen::Index k = 0; k < response.size(); ++k)
    spectrum_[static_cast<std::size_t>(k)] *= response(k);
  fft_.inv(time_, spectrum_, padded_);
  return Eigen::Map<const Eigen::ArrayXd>(time_.data() + before_, samples_);
}

}  // namespace servotwin
