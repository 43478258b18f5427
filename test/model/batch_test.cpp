#include "helix_arm/model/batch.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "lie/coefficients.hpp"
#include "support/linked_arm.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::model {
namespace {

constexpr double kEps = 2.220446049250313e-16;

std::vector<std::vector<double>> randomColumns(const Arm& arm, std::size_t count, unsigned seed) {
  test::Random random(seed);
  std::vector<std::vector<double>> out(arm.actuatorCount(), std::vector<double>(count));
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    for (double& value : out[i])
      value = random.uniform(arm.actuator(i).limits.lower, arm.actuator(i).limits.upper);
  }
  return out;
}

std::vector<const double*> pointersTo(const std::vector<std::vector<double>>& columns,
                                      std::size_t first = 0) {
  std::vector<const double*> out;
  for (const std::vector<double>& column : columns) out.push_back(column.data() + first);
  return out;
}

// The same inputs, one row each.
std::vector<double> rowsOf(const std::vector<std::vector<double>>& columns) {
  std::vector<double> out;
  for (std::size_t j = 0; j < columns[0].size(); ++j) {
    for (const std::vector<double>& column : columns) out.push_back(column[j]);
  }
  return out;
}

InputArray arrayOf(const std::vector<double>& rows, std::ptrdiff_t columns, std::size_t first = 0) {
  constexpr auto kNumber = static_cast<std::ptrdiff_t>(sizeof(double));
  return {rows.data() + static_cast<std::ptrdiff_t>(first) * columns, columns * kNumber, kNumber};
}

// The numbers as columns of `rows` each.
InputArray columnsOf(const std::vector<double>& numbers, std::ptrdiff_t rows) {
  constexpr auto kNumber = static_cast<std::ptrdiff_t>(sizeof(double));
  return {numbers.data(), kNumber, rows * kNumber};
}

// One column after the other.
std::vector<double> joined(const std::vector<std::vector<double>>& columns) {
  std::vector<double> out;
  for (const auto& column : columns) out.insert(out.end(), column.begin(), column.end());
  return out;
}

// Tips by columns, one row each.
std::vector<double> tipsOf(const TipBatch& batch, const std::vector<std::vector<double>>& columns) {
  const std::size_t count = columns[0].size();
  std::vector<std::vector<double>> tips(3, std::vector<double>(count));
  batch.columns(pointersTo(columns).data(), count, tips[0].data(), tips[1].data(), tips[2].data());
  return rowsOf(tips);
}

// A thin arm: some angles within the series and some beyond.
Arm thinArm() {
  test::Ring ring = test::straightRing();
  ring.radius = 0.008;
  ring.stiffness.kappa = 1e-6;
  return test::ringArm(ring);
}

// Worst distance of the batch's tips from the single call's, in eps of the arm's rest length.
double worstDifference(const Arm& arm, const std::vector<std::vector<double>>& q) {
  const std::size_t count = q[0].size();
  std::vector<double> x(count + 1, -7), y(count + 1, -7), z(count + 1, -7);
  TipBatch(arm).columns(pointersTo(q).data(), count, x.data(), y.data(), z.data());
  EXPECT_EQ(x[count], -7) << "wrote past the end";
  double length = 0;
  for (int k = 0; k < arm.sectionCount(); ++k) length += arm.restTwist(k).head<3>().norm();
  double worst = 0;
  Eigen::VectorXd one(arm.actuatorCount());
  for (std::size_t j = 0; j < count; ++j) {
    for (int i = 0; i < one.size(); ++i) one[i] = q[i][j];
    worst = std::max(worst, (arm.tip(one).translation - Eigen::Vector3d(x[j], y[j], z[j])).norm());
  }
  return worst / (kEps * length);
}
double worstDifference(const Arm& arm, std::size_t count, unsigned seed) {
  return worstDifference(arm, randomColumns(arm, count, seed));
}

TEST(Batch, AgreesWithTheSingleCallTo8Eps) {
  for (const auto& ring : {test::straightRing(), test::helicalRing()}) {
    EXPECT_LE(worstDifference(test::ringArm(ring), 200000, 71), 8.0);
  }
}

TEST(Batch, HandlesEveryCountAroundItsBlocks) {
  const Arm arm = test::ringArm(test::straightRing());
  for (const std::size_t count : {0, 1, 7, 8, 9, 127, 128, 129, 255, 256, 257, 1000, 4103}) {
    EXPECT_LE(worstDifference(arm, count, 72), 8.0) << count;
  }
}

TEST(Batch, HandlesEveryNumberOfActuatorsAndSections) {
  for (const int actuators : {1, 2, 3, 4, 5, 6, 7, 24}) {
    for (const int sections : {1, 2, 4}) {
      const Arm arm = test::ringArm(test::straightRing(actuators), sections);
      EXPECT_LE(worstDifference(arm, 500, 73), 8.0)
          << actuators << " actuators, " << sections << " sections";
    }
  }
}

TEST(Batch, AgreesWithTheSingleCallOnBothSidesOfTheSeriesLimit) {
  const Arm arm = thinArm();
  std::vector<std::vector<double>> q(3);
  test::Random random(78);
  int near = 0, far = 0;
  while (q[0].size() < 2000) {
    // Along a ray from rest, the pressures where the angle passes the limit.
    const Eigen::VectorXd end = test::randomInput(arm, random);
    const auto squaredAngle = [&](double part) {
      return arm.twists(part * end).bottomRows(3).squaredNorm();
    };
    if (squaredAngle(1.0) < 1.001 * lie::kSeriesLimit) continue;
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (squaredAngle(middle) < lie::kSeriesLimit ? low : high) = middle;
    }
    const double part = low * (1.0 + random.uniform(-1e-6, 1e-6));
    squaredAngle(part) <= lie::kSeriesLimit ? ++near : ++far;
    for (int i = 0; i < 3; ++i) q[i].push_back(part * end[i]);
  }
  ASSERT_GT(near, 500);
  ASSERT_GT(far, 500);
  EXPECT_LE(worstDifference(arm, q), 12.0);
}

TEST(Batch, LargeBatchesAreTheSameAtEveryAlignment) {
  constexpr std::size_t kCount = 101'003;
  const Arm arm = test::ringArm(test::helicalRing());
  const std::vector<std::vector<double>> q = randomColumns(arm, kCount, 80);
  const std::vector<double> rows = rowsOf(q);
  const std::vector<double> by_columns = joined(q);
  const TipBatch batch(arm);
  std::vector<double> expected(3 * kCount);
  for (std::size_t first = 0; first < kCount; first += 1000) {
    const std::size_t count = std::min<std::size_t>(1000, kCount - first);
    batch.rows(arrayOf(rows, 3, first), count, &expected[3 * first]);
  }
  // At every distance from a line of the caches; y and z at others than x, too.
  for (std::size_t shift = 0; shift < 8; ++shift) {
    std::vector<double> tips(3 * kCount + 16, -7);
    EXPECT_TRUE(batch.rows(arrayOf(rows, 3), kCount, &tips[shift]));
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), &tips[shift])) << shift;
    std::fill(tips.begin(), tips.end(), -7);
    EXPECT_TRUE(batch.rows(columnsOf(by_columns, kCount), kCount, &tips[shift]));
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), &tips[shift])) << shift;
    EXPECT_EQ(tips[shift + 3 * kCount], -7);
    for (const std::size_t apart : {0, 3}) {
      std::vector<double> x(kCount + 16, -7), y(x), z(x);
      batch.columns(pointersTo(q).data(), kCount, &x[shift], &y[shift + apart], &z[shift]);
      std::size_t wrong = 0;
      for (std::size_t j = 0; j < kCount; ++j) {
        wrong += x[shift + j] != expected[3 * j] || y[shift + apart + j] != expected[3 * j + 1] ||
                 z[shift + j] != expected[3 * j + 2];
      }
      EXPECT_EQ(wrong, 0) << shift << " " << apart;
      EXPECT_EQ(x[shift + kCount], -7);
    }
  }
}

// A muscle with a table, a tendon and a polynomial.
Arm tableArm(int sections = 1) {
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  const Contraction table = Contraction::table({0, 1e5, 2e5, 4e5}, {0.43, 0.41, 0.36, 0.34});
  section.actuators[0].contraction = table;
  section.actuators[0].limits = table.inputRange();
  section.actuators[1].contraction = Contraction::tendon(0.43, 0.01, 8);
  section.actuators[1].limits = {0, 8};
  return Arm(std::vector<Section>(static_cast<std::size_t>(sections), section));
}

TEST(Batch, RowsOfTablesTapersAndLinksAreTheTipsOfTheirColumns) {
  constexpr std::size_t kCount = 700;
  for (const Arm& arm :
       {tableArm(), tableArm(2), test::taperedArm(), test::taperedArm(0.26), test::linkedArm()}) {
    const std::vector<std::vector<double>> q = randomColumns(arm, kCount, 82);
    const std::vector<double> rows = rowsOf(q);
    const std::vector<double> by_columns = joined(q);
    EXPECT_LE(worstDifference(arm, 5000, 76), 8.0);
    const TipBatch batch(arm);
    const std::vector<double> expected = tipsOf(batch, q);
    std::vector<double> tips(3 * kCount + 1, -7);
    EXPECT_TRUE(batch.rows(arrayOf(rows, arm.actuatorCount()), kCount, tips.data()));
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), tips.begin()));
    EXPECT_EQ(tips.back(), -7) << "wrote past the end";
    std::fill(tips.begin(), tips.end(), -7);
    EXPECT_TRUE(batch.rows(columnsOf(by_columns, kCount), kCount, tips.data()));
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), tips.begin()));
  }
}

TEST(Batch, RowsTellWhetherAllInputsAreInside) {
  constexpr std::size_t kRows = 21;
  for (const Arm& arm : {test::ringArm(test::straightRing()), tableArm(), test::taperedArm()}) {
    const auto actuators = static_cast<std::size_t>(arm.actuatorCount());
    // The limits are inside.
    std::vector<std::vector<double>> q = randomColumns(arm, kRows, 83);
    for (std::size_t i = 0; i < actuators; ++i) {
      const Range limits = arm.actuator(static_cast<int>(i)).limits;
      q[i].front() = limits.lower;
      q[i].back() = limits.upper;
    }
    const std::vector<double> rows = rowsOf(q);
    const TipBatch batch(arm);
    const std::vector<double> inside = tipsOf(batch, q);
    std::vector<double> tips(3 * kRows);
    ASSERT_TRUE(batch.rows(arrayOf(rows, arm.actuatorCount()), kRows, tips.data()));
    for (std::size_t at = 0; at < rows.size(); ++at) {
      const Range limits = arm.actuator(static_cast<int>(at % actuators)).limits;
      for (const double bad : {std::nextafter(limits.upper, 1e9), std::nan(""),
                               std::nextafter(limits.lower, -1.0), -HUGE_VAL, HUGE_VAL}) {
        std::vector<double> numbers = rows;
        numbers[at] = bad;
        EXPECT_FALSE(batch.rows(arrayOf(numbers, arm.actuatorCount()), kRows, tips.data()))
            << bad << " at " << at;
        // Only its own row suffers.
        for (std::size_t i = 0; i < tips.size(); ++i) {
          if (i / 3 == at / actuators) continue;
          EXPECT_EQ(tips[i], inside[i]) << at;
        }
        auto columns = q;
        columns[at % actuators][at / actuators] = bad;
        EXPECT_FALSE(batch.rows(columnsOf(joined(columns), kRows), kRows, tips.data()))
            << bad << " at " << at << ", by columns";
      }
    }
  }
}

}  // namespace
}  // namespace helix_arm::model
