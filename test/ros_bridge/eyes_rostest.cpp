// The vision node and nodelet on pictures that the test makes: sound ones are measured in, all
// others are counted, named, and measured in never.
#include <Eigen/Eigenvalues>

#include "support/vision_rig.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::test {
namespace {

const std::vector<double> kBent = {2.5e5, 1e5, 2e4};  // [Pa]

// One stand-in for each node, through all tests: to connect takes longer than to test.
class StandIns : public ::testing::Environment {
 public:
  static CameraStandIn& of(const std::string& ns) {
    auto& place = all()[ns];
    if (place == nullptr) place = std::make_unique<CameraStandIn>(ns);
    return *place;
  }
  void TearDown() override { all().clear(); }

 private:
  static std::map<std::string, std::unique_ptr<CameraStandIn>>& all() {
    static std::map<std::string, std::unique_ptr<CameraStandIn>> stand_ins;
    return stand_ins;
  }
};

const auto* const kStandIns = ::testing::AddGlobalTestEnvironment(new StandIns);

class Eyes : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    ASSERT_TRUE(eye_.connect());
    eye_.publish(eye_.info());
    ASSERT_TRUE(showAndMeasure(bent_));
  }

  // The measurement of a sound picture; null, after a failure, when there was none.
  ArmShape::ConstPtr showAndMeasure(const model::Twists& shape) {
    const cv::Mat picture = eye_.picture(shape);
    ArmShape::ConstPtr measured;
    // The node may not have accepted the publisher yet, so the picture is shown more than once.
    const bool came = waitFor([&] {
      const ros::Time stamp = eye_.stamp();
      eye_.show(picture, stamp);
      measured = VisionListener::of(eye_.measured, stamp, 1.0);
      return measured != nullptr;
    });
    EXPECT_TRUE(came) << "nothing was measured; "
                      << (eye_.status.all().empty() ? "" : eye_.status.last().message);
    return measured;
  }

  VisionStatus lastStatus() { return eye_.status.last(); }

  // What must be told of a fault: counted, and named with the word.
  void expectTold(const std::string& word, std::uint64_t VisionStatus::*counter,
                  std::uint64_t before) {
    const auto status = eye_.tells([&](const VisionStatus& s) {
      return before < s.*counter && s.state == VisionStatus::CAMERA_FAULT;
    });
    ASSERT_TRUE(status) << word << ": not told";
    EXPECT_NE(status->message.find(word), std::string::npos) << word << " in: " << status->message;
    EXPECT_NE(status->last_fault.find(word), std::string::npos) << status->last_fault;
  }

  // Sends a bad picture, which must be told of; that it was not measured in shows with the next
  // sound one.
  template <class Send>
  void expectRefused(const std::string& word, std::uint64_t VisionStatus::*counter, Send&& send) {
    const std::uint64_t before = lastStatus().*counter;
    const ros::Time stamp = eye_.stamp();
    send(stamp);
    expectTold(word, counter, before);
    bad_.push_back(stamp);
  }

  void TearDown() override {
    eye_.publish(eye_.info());
    EXPECT_TRUE(showAndMeasure(bent_));
    for (const auto& measured : eye_.measured.all()) {
      EXPECT_EQ(std::count(bad_.begin(), bad_.end(), measured->header.stamp), 0);
    }
  }

  double tipDistance(const ArmShape& measured, const model::Twists& shape) const {
    return (ros_bridge::fromMsg(measured.tip).translation - model::tipPose(shape).translation)
        .norm();
  }

  CameraStandIn& eye_ = StandIns::of(GetParam());
  const model::Twists bent_ = eye_.twists(kBent);
  std::vector<ros::Time> bad_;  // stamps of pictures that must not be measured in
};

class AllEyes : public Eyes {};
class JpegEye : public Eyes {};
INSTANTIATE_TEST_SUITE_P(, AllEyes, ::testing::Values("jpeg", "raw"));
INSTANTIATE_TEST_SUITE_P(, JpegEye, ::testing::Values("jpeg"));

TEST_P(AllEyes, MeasureTheShapeAtTheTimeOfThePicture) {
  for (const std::vector<double>& pressure :
       {kBent, {0, 0, 0}, {1e5, 3e5, 1e5}, {3e4, 1e5, 2.5e5}}) {
    const model::Twists shape = eye_.twists(pressure);
    const auto measured = showAndMeasure(shape);
    ASSERT_TRUE(measured);
    EXPECT_EQ(measured->tier, "measured");
    EXPECT_EQ(measured->header.frame_id, GetParam() + "_arm_base");
    ASSERT_EQ(measured->sections, 1U);
    ASSERT_EQ(measured->twist_covariance.size(), 36U);
    EXPECT_LT(tipDistance(*measured, shape), 0.003);
    const Eigen::MatrixXd covariance =
        Eigen::Map<const Eigen::MatrixXd>(measured->twist_covariance.data(), 6, 6);
    EXPECT_TRUE(covariance.isApprox(covariance.transpose(), 1e-9));
    const Eigen::Matrix3d of_tip = estimation::tipCovariance(
        model::Twists(Eigen::Map<const model::Twists>(measured->twist.data(), 6, 1)), covariance);
    const Eigen::Vector3d variances = of_tip.selfadjointView<Eigen::Lower>().eigenvalues();
    EXPECT_GT(variances.minCoeff(), 0);
    EXPECT_LT(variances.maxCoeff(), 0.005 * 0.005);
    // Its detections name the tags that were used.
    const auto detections = VisionListener::of(eye_.detections, measured->header.stamp);
    ASSERT_TRUE(detections);
    int fitted = 0;
    for (const TagDetection& tag : detections->tags) {
      fitted += tag.fitted && tag.known && !tag.repeated && !tag.outlier;
    }
    EXPECT_GE(fitted, 4);
  }
}

// The same bytes with new stamps, while the model moves: the camera hangs.
TEST_P(JpegEye, APictureThatComesAgainWhileTheModelMovesIsRefused) {
  const model::Twists other = eye_.twists({1e5, 3e5, 1e5});
  ASSERT_GT((model::tipPose(other).translation - model::tipPose(bent_).translation).norm(),
            vision::FrozenWatch::kMotion);
  const cv::Mat picture = eye_.picture(bent_);
  const auto showWith = [&](const model::Twists& model) {
    std_msgs::Header header;
    header.stamp = eye_.stamp();
    eye_.publish(ros_bridge::toShapeMsg(header, "linear", model));
    eye_.show(picture, header.stamp);
    return header.stamp;
  };
  for (int k = 0; k < 3; ++k) {
    ASSERT_TRUE(VisionListener::of(eye_.measured, showWith(bent_))) << "an arm at rest";
  }
  // The first pictures may overtake their model.
  const std::uint64_t before = lastStatus().source_faults;
  ASSERT_TRUE(waitFor([&] {
    showWith(other);
    return lastStatus().source_faults > before;
  }));
  expectRefused("it hangs", &VisionStatus::source_faults,
                [&](const ros::Time&) { bad_.push_back(showWith(other)); });
  showWith(bent_);
}

}  // namespace
}  // namespace helix_arm::test
