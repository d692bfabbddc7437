// Kernels of every instruction set against their definitions, on a frame that is no multiple of the block size.
#include "src/motion/kernels.hpp"
#include "tests/motion/reference.hpp"

namespace bolo::motion::kernels_test {

constexpr Geometry kFrame{45, 29};

class MotionKernels : public testing::TestWithParam<std::string_view> {
 protected:
  MotionKernels() {
    for (PaddedPlane* p : {&a_, &b_, &c_}) {
      for_pixels([&](int x, int y) { *p->at(x, y) = normal_(random_); });
      p->extend();
    }
    for (VectorField* f : {&d_, &e_, &unit_}) *f = VectorField(a_.blocks_across(), a_.blocks_down());
    for (Vec2& d : d_) d = {6.0F * normal_(random_), 4.0F * normal_(random_)};
    for (Vec2& d : e_) d = {normal_(random_), normal_(random_)};
    d_[0] = {60.0F, -3.0F};  // beyond the frame
    for (Vec2& u : unit_) {
      const float angle = 7.0F * normal_(random_);
      u = {std::cos(angle), std::sin(angle)};
    }
  }
  ScalarField field() const { return {a_.blocks_across(), a_.blocks_down()}; }
  template <typename Check>
  void for_pixels(const Check& check) {
    for (int y = 0; y < kFrame.height; ++y) {
      for (int x = 0; x < kFrame.width; ++x) check(x, y);
    }
  }
  // Of a block's pixels inside the frame.
  template <typename Of>
  double mean_square(int column, int row, const Of& of) {
    double sum = 0.0;
    int count = 0;
    for_pixels([&](int x, int y) {
      if (x / kBlock == column && y / kBlock == row) sum += std::pow(of(x, y), 2), ++count;
    });
    return sum / count;
  }
  template <typename T>
  static std::array<const T*, 3> rows(const BlockField<T>& f, int row) {
    return {f.row(std::max(row - 1, 0)), f.row(row), f.row(std::min(row + 1, f.down() - 1))};
  }

  std::mt19937 random_{7};
  std::normal_distribution<float> normal_{0.0F, 1.0F};
  PaddedPlane a_{kFrame};
  PaddedPlane b_{kFrame};
  PaddedPlane c_{kFrame};
  PaddedPlane out_{kFrame};
  VectorField d_;
  VectorField e_;
  VectorField unit_;
  const Kernels& kernels_ = best_kernels(GetParam());
};

TEST_P(MotionKernels, Innovate) {
  kernels_.innovate(a_, b_, 2.75F, 0, kFrame.height, out_);
  for_pixels([&](int x, int y) { ASSERT_NEAR(*out_.at(x, y), 2.75 * *a_.at(x, y) - 1.75 * *b_.at(x, y), 1e-5); });
}

TEST_P(MotionKernels, Smooth) {
  kernels_.smooth(a_, 0, kFrame.height, out_);
  std::array<double, 9> w{};
  double total = 0.0;
  for (int i = -4; i <= 4; ++i) total += w[static_cast<std::size_t>(i + 4)] = std::exp(-0.5 * i * i);
  for_pixels([&](int x, int y) {
    double sum = 0.0;
    for (int j = -4; j <= 4; ++j) {
      for (int i = -4; i <= 4; ++i) {
        sum += w[static_cast<std::size_t>(i + 4)] * w[static_cast<std::size_t>(j + 4)] *
               reference::value(a_, x + i, y + j);
      }
    }
    ASSERT_NEAR(*out_.at(x, y), sum / total / total, 1e-4);
  });
}

TEST_P(MotionKernels, Halve) {
  PaddedPlane half({kFrame.width / 2, kFrame.height / 2});
  kernels_.halve(a_, 0, kFrame.height / 2, half);
  for (int y = 0; y < kFrame.height / 2; ++y) {
    for (int x = 0; x < kFrame.width / 2; ++x) {
      const double sum =
          *a_.at(2 * x, 2 * y) + *a_.at(2 * x + 1, 2 * y) + *a_.at(2 * x, 2 * y + 1) + *a_.at(2 * x + 1, 2 * y + 1);
      ASSERT_NEAR(*half.at(x, y), sum / 4, 1e-5);
    }
  }
}

TEST_P(MotionKernels, NextExtreme) {
  const int last = kFrame.width - 1;
  for_pixels([&](int x, int y) {
    for (const float least : {0.5F, 1.5F}) {
      const int first = std::max(x, 1);
      int want = first;
      while (want < last && !reference::is_extreme(a_, want, y, least)) ++want;
      ASSERT_EQ(kernels_.next_extreme(a_.at(0, y), a_.stride(), first, last, least), want) << x << " " << y;
    }
  });
}

TEST_P(MotionKernels, MeanDifference) {
  for (const auto& [dx, dy] : {std::pair{0, 0}, {5, -3}, {-7, 2}, {20, 0}}) {
    double sum = 0.0;
    int count = 0;
    for_pixels([&, dx = dx, dy = dy](int x, int y) {
      if (!reference::inside(kFrame, x - dx, y - dy, 0)) return;
      sum += std::abs(*b_.at(x, y) - *a_.at(x - dx, y - dy));
      ++count;
    });
    EXPECT_NEAR(kernels_.mean_difference(a_, b_, dx, dy), sum / count, 1e-4) << dx << " " << dy;
  }
  EXPECT_GT(kernels_.mean_difference(a_, b_, 44, 0), 1e9F);
}

TEST_P(MotionKernels, Match) {
  std::vector<MatchSums> sums(d_.size());
  for (int r = 0; r < d_.down(); ++r) {
    kernels_.match(a_, b_, d_.row(r), r, 1.0F, sums.data());
    for (int c = 0; c < d_.across(); ++c) {
      const auto want = reference::match(a_, b_, d_.at(c, r), c, r, 1.0);
      const MatchSums& s = sums[static_cast<std::size_t>(c)];
      const std::array<float, 7> got{s.xx, s.xy, s.yy, s.xe, s.ye, s.ee, s.count};
      for (std::size_t i = 0; i < got.size(); ++i) ASSERT_NEAR(got[i], want[i], 1e-3) << c << " " << r << " " << i;
    }
  }
}

TEST_P(MotionKernels, PullOfNoise) {
  constexpr int kCount = 21;  // no multiple of the vector length
  std::vector<Vec2> d(kCount);
  for (int i = 0; i < kCount; ++i) d[static_cast<std::size_t>(i)] = {0.37F * static_cast<float>(i - 8), 0.6F};
  std::vector<Vec2> pull(kCount);
  kernels_.pull(d.data(), kCount, 2.0F, pull.data());
  for (std::size_t i = 0; i < d.size(); ++i) {
    EXPECT_NEAR(pull[i].x, 2.0 * reference::pull(d[i].x, d[i].y), 1e-5) << i;
    EXPECT_NEAR(pull[i].y, 2.0 * reference::pull(d[i].y, d[i].x), 1e-5) << i;
  }
  d[0] = {7.0F, 1.1F};  // too far: no bias is left
  kernels_.pull(d.data(), 1, 2.0F, pull.data());
  EXPECT_EQ(pull[0].x, 0.0F);
}

TEST_P(MotionKernels, CostAndEnergy) {
  constexpr float kCap = 2.0F;
  ScalarField cost = field();
  ScalarField mean = field();
  ScalarField square = field();
  for (int r = 0; r < d_.down(); ++r) {
    kernels_.cost(a_, b_, d_.row(r), r, kCap, cost.row(r));
    kernels_.energy(b_, r, mean.row(r), square.row(r));
    for (int c = 0; c < d_.across(); ++c) {
      double sum = 0.0;
      double first = 0.0;
      double second = 0.0;
      for (int i = 0; i < kBlock * kBlock; ++i) {  // whole blocks: the frame's border is repeated
        const int x = c * kBlock + i % kBlock;
        const int y = r * kBlock + i / kBlock;
        const reference::Point d = d_.at(c, r);
        const double v = reference::value(b_, x, y);
        const double e = v - reference::bilinear(a_, x - d.x, y - d.y);
        sum += std::min(e * e, static_cast<double>(kCap));
        first += v;
        second += v * v;
      }
      const double pixels = kBlock * kBlock;
      ASSERT_NEAR(cost.at(c, r), sum / pixels, 1e-4);
      ASSERT_NEAR(mean.at(c, r), first / pixels, 1e-5);
      ASSERT_NEAR(square.at(c, r), second / pixels - first * first / pixels / pixels, 1e-4);
    }
  }
}

TEST_P(MotionKernels, SearchFindsWhatWasShifted) {
  PaddedPlane moved(kFrame);
  for_pixels([&](int x, int y) { *moved.at(x, y) = static_cast<float>(reference::value(a_, x - 5, y + 3)); });
  moved.extend();
  const Vec2 from_rest = kernels_.search(a_, moved, 5, 3, {0.0F, 0.0F}, 1e-3F);
  EXPECT_EQ(from_rest.x, 5.0F);
  EXPECT_EQ(from_rest.y, -3.0F);
  const Vec2 from_near = kernels_.search(a_, moved, 5, 3, {4.0F, -2.0F}, 1e-3F);
  EXPECT_EQ(from_near.x, 1.0F);
  EXPECT_EQ(from_near.y, -1.0F);
}

TEST_P(MotionKernels, AlignTakesTheMeanOfThoseThatSee) {
  const std::array<const PaddedPlane*, 2> planes{&a_, &b_};
  for (int r = 0; r < d_.down(); ++r) {
    const std::array<const Vec2*, 2> d{d_.row(r), e_.row(r)};
    kernels_.align(planes.data(), d.data(), 2, c_, r, out_);
  }
  for_pixels([&](int x, int y) {
    double sum = 0.0;
    int count = 0;
    for (int i = 0; i < 2; ++i) {
      const reference::Point d = (i == 0 ? d_ : e_).at(x / kBlock, y / kBlock);
      if (!reference::inside(kFrame, x - d.x, y - d.y, 0.0)) continue;
      sum += reference::bicubic(i == 0 ? a_ : b_, x - d.x, y - d.y);
      ++count;
    }
    const double want = count > 0 ? sum / count : static_cast<double>(*c_.at(x, y));
    ASSERT_NEAR(*out_.at(x, y), want, 1e-4) << x << " " << y;
  });
}

TEST_P(MotionKernels, DifferIsTheMeanOfWhatAllSeeLessAPlane) {
  const std::array<const PaddedPlane*, 2> planes{&a_, &b_};
  for (Vec2& d : d_) d = d * 0.5F;
  out_.fill(7.0F);
  ScalarField square = field();
  for (int r = 0; r < d_.down(); ++r) {
    const std::array<const Vec2*, 2> d{d_.row(r), e_.row(r)};
    kernels_.differ(planes.data(), d.data(), 2, c_, r, {0, 1}, out_, square.row(r));
    kernels_.differ(planes.data(), d.data(), 2, c_, r, {1, 3}, out_, square.row(r));
  }
  int whole = 0;
  for (int r = 0; r < d_.down(); ++r) {
    for (int c = 0; c < 3; ++c) {
      const auto sees = [&](Vec2 d, int x, int y) {
        return reference::inside(kFrame, x - static_cast<double>(d.x), y - static_cast<double>(d.y), -1.0);
      };
      bool seen = true;
      for (const Vec2 d : {d_.at(c, r), e_.at(c, r)}) {
        seen = seen && sees(d, c * kBlock, r * kBlock) && sees(d, (c + 1) * kBlock - 1, (r + 1) * kBlock - 1);
      }
      whole += seen ? 1 : 0;
      double sum = 0.0;
      for (int i = 0; i < kBlock * kBlock; ++i) {
        const int x = c * kBlock + i % kBlock;
        const int y = r * kBlock + i / kBlock;
        const reference::Point d = d_.at(c, r);
        const reference::Point e = e_.at(c, r);
        const double mean = 0.5 * (reference::bicubic(a_, x - d.x, y - d.y) + reference::bicubic(b_, x - e.x, y - e.y));
        const double want = seen ? mean - static_cast<double>(*c_.at(x, y)) : 0.0;
        ASSERT_NEAR(*out_.at(x, y), want, 1e-4) << x << " " << y;
        sum += want * want / 64;
      }
      EXPECT_NEAR(square.at(c, r), seen ? sum : static_cast<double>(kUnseen), 1e-4) << c << " " << r;
    }
  }
  EXPECT_GT(whole, 2);
  EXPECT_LT(whole, 12);
  EXPECT_EQ(*out_.at(3 * kBlock, 0), 7.0F);  // of other columns
}

TEST_P(MotionKernels, Fit) {
  ScalarField lag = field();
  for (float& l : lag) l = 2.0F + std::abs(3.0F * normal_(random_));
  BlockField<FitSums> sums(d_.across(), d_.down());
  for (int r = 0; r < d_.down(); ++r) kernels_.fit(a_, b_, unit_.row(r), lag.row(r), r, sums.row(r));
  for (int r = 0; r < d_.down(); ++r) {
    for (int c = 0; c < d_.across(); ++c) {
      const reference::Point u = unit_.at(c, r);
      const double l = lag.at(c, r);
      std::array<double, 5> want{};
      for (int i = 0; i < kBlock * kBlock; ++i) {
        const int x = c * kBlock + i % kBlock;
        const int y = r * kBlock + i / kBlock;
        const double m = reference::value(b_, x, y);
        const double g = 0.5 * (reference::bilinear(b_, x + u.x, y + u.y) - reference::bilinear(b_, x - u.x, y - u.y));
        const double s = reference::bilinear(b_, x + l * u.x, y + l * u.y) - m;
        const double e = reference::value(a_, x, y) - m;
        want[0] += e * e / 64;
        want[1] += g * g / 64;
        want[2] += s * s / 64;
        want[3] += std::pow(reference::across(b_, x, y, u, 2) - m, 2) / 64;
        want[4] += std::pow(reference::across(b_, x, y, u, 1) - m, 2) / 64;
      }
      ASSERT_NEAR(sums.at(c, r).error, want[0], 1e-4);
      ASSERT_NEAR(sums.at(c, r).gradient, want[1], 1e-4);
      ASSERT_NEAR(sums.at(c, r).structure, want[2], 1e-4);
      ASSERT_NEAR(sums.at(c, r).across, want[3], 1e-4);
      ASSERT_NEAR(sums.at(c, r).fine, want[4], 1e-4);
    }
  }
}

TEST_P(MotionKernels, Filter) {
  BlockField<FilterWeights> weights(d_.across(), d_.down());
  for (FilterWeights& w : weights) {
    for (float& v : w.w) v = 0.2F * normal_(random_);
  }
  const FilterInputs in{&a_, &b_, &c_, {&c_, &a_}};
  for (int r = 0; r < d_.down(); ++r) kernels_.filter(in, unit_.row(r), rows(weights, r).data(), r, out_);
  for_pixels([&](int x, int y) {
    const reference::Point u = unit_.at(x / kBlock, y / kBlock);
    const auto weight = [&](int i) {
      return reference::between(kFrame, x, y, [&](int c, int r) { return weights.at(c, r).w[i]; });
    };
    double want = weight(FilterWeights::kBefore) * *c_.at(x, y) + weight(FilterWeights::kBefore + 1) * *a_.at(x, y);
    for (int j = 0; j < kTaps; ++j) {
      const double px = x + (j - kReach) * u.x;
      const double py = y + (j - kReach) * u.y;
      const int apart = std::abs(j - kReach);
      const int values = apart <= 2 ? 6 : apart == 3 ? 4 : 2;
      want += weight(j) * reference::between_values(a_, values, px, py);
      want += weight(FilterWeights::kMean + j) * reference::between_values(b_, values, px, py);
      want += weight(FilterWeights::kAhead + j) * reference::between_values(c_, values, px, py);
    }
    ASSERT_NEAR(*out_.at(x, y), want, 1e-3) << x << " " << y;
  });
}

TEST_P(MotionKernels, Across) {
  BlockField<AcrossWeights> weights(d_.across(), d_.down());
  for (AcrossWeights& across : weights) {
    for (float& v : across.w) v = 0.2F * normal_(random_);
  }
  for (int r = 0; r < d_.down(); ++r) kernels_.across(a_, unit_.row(r), weights.row(r), r, out_);
  for_pixels([&](int x, int y) {
    const reference::Point u = unit_.at(x / kBlock, y / kBlock);
    const double here = *a_.at(x, y);
    double want = here;
    for (int i = 1; i <= AcrossWeights::kReach; ++i) {
      const double beside = reference::across(a_, x, y, u, i) + reference::across(a_, x, y, u, -i);
      want += weights.at(x / kBlock, y / kBlock).w[i - 1] * (beside - 2 * here);
    }
    ASSERT_NEAR(*out_.at(x, y), want, 1e-4) << x << " " << y;
  });
}

TEST_P(MotionKernels, Check) {
  constexpr float kRatio = 0.45F;
  ScalarField left = field();
  ScalarField change = field();
  for (int r = 0; r < d_.down(); ++r) {
    kernels_.check(a_, b_, c_, d_.row(r), kRatio, r, out_, left.row(r), change.row(r));
  }
  for_pixels([&](int x, int y) {
    const reference::Point d = d_.at(x / kBlock, y / kBlock);
    const int steps = std::clamp(static_cast<int>(std::ceil(std::hypot(d.x, d.y))), 3, 30);
    double sum = 0.0;
    double total = 0.0;
    std::array<double, 2> blur{};
    std::array<double, 2> middle{};
    for (int i = 0; i < steps; ++i) {
      const double f = (i + 0.5) / steps;
      const double share = std::exp(-static_cast<double>(kRatio) * f);
      sum += share * reference::bilinear(a_, x + f * d.x, y + f * d.y);
      total += share;
      for (std::size_t axis = 0; axis < 2; ++axis) {
        const double at = f * (axis == 0 ? d.x : d.y);
        blur[axis] += share * (at - std::floor(at)) * (std::ceil(at) - at);
        middle[axis] += share * at;
      }
    }
    // Undo the blur of linear interpolation by the second differences at the trail's middle; not on long trails.
    const int mx = x + static_cast<int>(std::floor(middle[0] / total + 0.5));
    const int my = y + static_cast<int>(std::floor(middle[1] / total + 0.5));
    const auto second = [&](int dx, int dy) {
      return reference::value(a_, mx + dx, my + dy) + reference::value(a_, mx - dx, my - dy) -
             2.0 * reference::value(a_, mx, my);
    };
    const double counts = std::clamp((5.0 - std::hypot(d.x, d.y)) / 4.0, 0.0, 1.0);
    sum -= 0.5 * counts * (blur[0] * second(1, 0) + blur[1] * second(0, 1));
    ASSERT_NEAR(*out_.at(x, y), *b_.at(x, y) - sum / total, 2e-4) << x << " " << y;
  });
  EXPECT_NEAR(left.at(1, 1), mean_square(1, 1, [&](int x, int y) { return *out_.at(x, y); }), 1e-4);
  EXPECT_NEAR(change.at(1, 1), mean_square(1, 1, [&](int x, int y) { return *b_.at(x, y) - *c_.at(x, y); }), 1e-4);
}

TEST_P(MotionKernels, CorrectBlendAndDistance) {
  ScalarField w = field();
  for (float& v : w) v = normal_(random_);
  ScalarField most = field();
  for (float& v : most) v = normal_(random_);
  ScalarField distance = field();
  const PaddedPlane before = a_;
  std::vector<float> blended(kFrame.pixels());
  std::vector<float> other(kFrame.pixels());
  for (float& v : other) v = normal_(random_);
  for (int r = 0; r < w.down(); ++r) {
    kernels_.correct(b_, rows(w, r).data(), r, {0, 2}, a_);
    kernels_.correct(b_, rows(w, r).data(), r, {2, w.across()}, a_);
    kernels_.blend(a_, other.data(), rows(w, r).data(), most.row(r), r, blended.data());
    kernels_.distance(a_, other.data(), r, distance.row(r));
  }
  for_pixels([&](int x, int y) {
    const double share = reference::between(kFrame, x, y, [&](int c, int r) { return w.at(c, r); });
    const std::size_t i = static_cast<std::size_t>(y) * kFrame.width + static_cast<std::size_t>(x);
    ASSERT_NEAR(*a_.at(x, y), *before.at(x, y) + share * *b_.at(x, y), 1e-5);
    const double taken = std::min<double>(share, most.at(x / kBlock, y / kBlock));
    ASSERT_NEAR(blended[i], taken * *a_.at(x, y) + (1 - taken) * other[i], 1e-5);
  });
  for (int c : {1, w.across() - 1}) {
    const auto apart = [&](int x, int y) {
      return *a_.at(x, y) - other[static_cast<std::size_t>(y * kFrame.width + x)];
    };
    EXPECT_NEAR(distance.at(c, w.down() - 1), mean_square(c, w.down() - 1, apart), 1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(Isas, MotionKernels, testing::ValuesIn(reference::isas()),
                         [](const auto& each) { return std::string(each.param); });

}  // namespace bolo::motion::kernels_test
