// SPDX-License-Identifier: Apache-2.0
#include "regista/control/kalman_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <limits>
#include <random>

namespace regista::control {
namespace {

constexpr double no_gate = std::numeric_limits<double>::infinity();

template <int rows, int columns>
Eigen::Matrix<double, rows, columns> random_matrix(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Matrix<double, rows, columns>::NullaryExpr([&] { return normal(random); });
}

TEST(KalmanFilter, moves_towards_a_measurement_by_the_ratio_of_the_variances) {
  KalmanFilter<1> filter;
  filter.p(0, 0) = 3;
  using Scalar = Eigen::Matrix<double, 1, 1>;
  const auto result = filter.correct<1>(Scalar{4}, Scalar{1}, Scalar{1}, no_gate);
  EXPECT_TRUE(result.fused);
  EXPECT_DOUBLE_EQ(result.nis, 4);
  EXPECT_DOUBLE_EQ(filter.x(0), 3);
  EXPECT_DOUBLE_EQ(filter.p(0, 0), 0.75);
}

TEST(KalmanFilter, keeps_everything_when_the_gate_refuses) {
  KalmanFilter<2> filter;
  const auto result =
      filter.correct<1>(Eigen::Matrix<double, 1, 1>{10}, Eigen::RowVector2d{1, 0}, Eigen::Matrix<double, 1, 1>{1}, 7);
  EXPECT_FALSE(result.fused);
  EXPECT_DOUBLE_EQ(result.nis, 50);
  EXPECT_EQ(filter.x, Eigen::Vector2d::Zero());
  EXPECT_EQ(filter.p, Eigen::Matrix2d::Identity());
}

TEST(KalmanFilter, refuses_an_innovation_that_is_not_a_number) {
  KalmanFilter<2> filter;
  const auto result = filter.correct<1>(Eigen::Matrix<double, 1, 1>{std::numeric_limits<double>::quiet_NaN()},
                                        Eigen::RowVector2d{1, 0}, Eigen::Matrix<double, 1, 1>{1}, no_gate);
  EXPECT_FALSE(result.fused);
  EXPECT_EQ(filter.x, Eigen::Vector2d::Zero());
}

TEST(KalmanFilter, two_channels_are_two_filters) {
  std::mt19937 random{1};
  KalmanFilter<3, 2> both;
  KalmanFilter<3> first, second;
  for (int i = 0; i < 50; ++i) {
    const auto f = random_matrix<3, 3>(random);
    const auto input = random_matrix<3, 2>(random);
    const auto y = random_matrix<1, 2>(random);
    const auto h = random_matrix<1, 3>(random);
    const Eigen::Matrix3d q = Eigen::Matrix3d::Identity();
    const Eigen::Matrix<double, 1, 1> r{0.5};
    both.predict(f, q, input);
    first.predict(f, q, input.col(0));
    second.predict(f, q, input.col(1));
    const double nis = both.correct<1>(y, h, r, no_gate).nis;
    const double separate =
        first.correct<1>(y.col(0), h, r, no_gate).nis + second.correct<1>(y.col(1), h, r, no_gate).nis;
    EXPECT_NEAR(nis, separate, 1e-12);
    EXPECT_TRUE(both.x.col(0).isApprox(first.x, 1e-12));
    EXPECT_TRUE(both.x.col(1).isApprox(second.x, 1e-12));
    EXPECT_TRUE(both.p.isApprox(first.p, 1e-12));
  }
}

TEST(KalmanFilter, covariance_stays_symmetric_and_positive_where_the_short_form_fails) {
  // Precise sensors on a vague state: (I - k h) p loses positivity within a few steps.
  std::mt19937 random{2};
  KalmanFilter<4> filter;
  filter.p *= 1e8;
  Eigen::Matrix4d short_form = filter.p;
  bool short_form_failed = false;
  const Eigen::Matrix2d r = 1e-9 * Eigen::Matrix2d::Identity();
  for (int i = 0; i < 20000; ++i) {
    const auto h = random_matrix<2, 4>(random);
    filter.correct<2>(Eigen::Vector2d::Zero(), h, r, no_gate);
    const Eigen::Matrix<double, 4, 2> k = short_form * h.transpose() * (h * short_form * h.transpose() + r).inverse();
    short_form = ((Eigen::Matrix4d::Identity() - k * h) * short_form).eval();
    short_form_failed |= !(Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>{short_form}.eigenvalues().minCoeff() > 0) ||
                         !short_form.isApprox(short_form.transpose(), 1e-6);
    if (i % 100 == 0) {
      EXPECT_EQ(filter.p, filter.p.transpose());
      const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>{filter.p}.eigenvalues().minCoeff();
      EXPECT_GT(least, 0) << i;
    }
  }
  EXPECT_TRUE(short_form_failed) << "the case is too easy to prove anything";
}

TEST(KalmanFilter, forgets_one_state_and_its_relations) {
  KalmanFilter<3> filter;
  filter.p << 4, 1, 1, 1, 5, 1, 1, 1, 6;
  filter.forget(1, 0.5);
  EXPECT_EQ(filter.p, (Eigen::Matrix3d{{4, 0, 1}, {0, 0.5, 0}, {1, 0, 6}}));
}

}  // namespace
}  // namespace regista::control
