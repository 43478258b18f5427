#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/procedures/settle_watch.hpp"

namespace helix_arm::procedures {
namespace {

TagObservation tagAt(int id, double x) { return {id, Eigen::Matrix<double, 2, 4>::Constant(x)}; }

Sample sampleOf(double time, double pressure, std::vector<TagObservation> tags) {
  return {time, Eigen::Vector2d(pressure, -pressure), std::move(tags)};
}

TEST(MedianSample, IsTheMiddleOneOfEveryNumberByItself) {
  const Sample median = medianOf({sampleOf(1, 10, {tagAt(3, 5), tagAt(7, 900)}),
                                  sampleOf(2, 30, {tagAt(3, 1), tagAt(7, 2)}),
                                  sampleOf(3, 20, {tagAt(3, 3), tagAt(7, 1)})});
  EXPECT_EQ(median.time, 3);
  EXPECT_EQ(median.pressure, Eigen::Vector2d(20, -20));
  ASSERT_EQ(median.tags.size(), 2u);
  EXPECT_EQ(median.tags[0].id, 3);
  EXPECT_EQ(median.tags[0].corners, tagAt(3, 3).corners);
  EXPECT_EQ(median.tags[1].corners, tagAt(7, 2).corners);
}

TEST(MedianSample, OfAnEvenNumberLiesHalfWayBetweenTheTwoInTheMiddle) {
  const Sample median = medianOf({sampleOf(1, 10, {tagAt(3, 5)}), sampleOf(2, 30, {tagAt(3, 1)})});
  EXPECT_EQ(median.pressure, Eigen::Vector2d(20, -20));
  EXPECT_EQ(median.tags.at(0).corners, tagAt(3, 3).corners);
}

TEST(MedianSample, LeavesOutTagsThatFewerThanHalfOfThePicturesShow) {
  const Sample median =
      medianOf({sampleOf(1, 1, {tagAt(1, 1), tagAt(2, 1)}), sampleOf(2, 1, {tagAt(2, 1)}),
                sampleOf(3, 1, {tagAt(2, 1), tagAt(5, 1)}), sampleOf(4, 1, {tagAt(5, 1)})});
  ASSERT_EQ(median.tags.size(), 2u);
  EXPECT_EQ(median.tags[0].id, 2);  // 3 of 4
  EXPECT_EQ(median.tags[1].id, 5);  // 2 of 4
}

TEST(MedianSample, OfNothingOrOfSeveralArmsIsRefused) {
  EXPECT_THROW(medianOf({}), std::invalid_argument);
  EXPECT_THROW(medianOf({sampleOf(1, 1, {}), {2, Eigen::Vector3d::Zero(), {}}}),
               std::invalid_argument);
}

}  // namespace
}  // namespace helix_arm::procedures
