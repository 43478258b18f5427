// The vision node and nodelet on pictures that the test makes: sound ones are measured in, all
// others are counted, named, and measured in never.
#include <Eigen/Eigenvalues>
#include <fstream>
#include <set>

#include <geometry_msgs/PoseStamped.h>
#include <tf2_msgs/TFMessage.h>

#include "ros_bridge/vision/observations.hpp"
#include "ros_bridge/vision/pose_source.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"
#include "support/vision_rig.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::test {
namespace {

using visualization_msgs::Marker;

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

TEST_P(AllEyes, ABlankPictureRemovesTheDrawing) {
  using Names = std::set<std::pair<std::string, int>>;
  // Those that are drawn, or taken away, with the last message; where a drawing has no model, it
  // takes the model's curve away.
  const auto last = [this](int action) {
    Names out;
    if (eye_.markers.all().empty()) return out;
    for (const Marker& marker : eye_.markers.last().markers) {
      EXPECT_EQ(marker.header.frame_id, GetParam() + "_arm_base");
      if (marker.action == action) out.emplace(marker.ns, marker.id);
    }
    return out;
  };
  Names drawn;
  ASSERT_TRUE(waitFor([&] {
    drawn = last(Marker::ADD);
    return !drawn.empty() || (showAndMeasure(bent_) && false);
  }));
  EXPECT_GT(eye_.markers.last().markers.at(0).lifetime.toSec(), 0.1);
  eye_.show(cv::Mat(eye_.scene.camera->model.height, eye_.scene.camera->model.width, CV_8UC1,
                    cv::Scalar(128)),
            eye_.stamp());
  EXPECT_TRUE(eye_.tells([](const VisionStatus& s) {
    return s.state == VisionStatus::NO_TAGS && s.tags == 0 && !s.message.empty();
  }));
  ASSERT_TRUE(waitFor([&] { return last(Marker::ADD).empty(); }));
  for (const auto& marker : drawn)
    EXPECT_EQ(last(Marker::DELETE).count(marker), 1U) << marker.first;
}

TEST_P(JpegEye, TheModelOfTheSameTimeIsComparedWith) {
  const auto stamp = eye_.stamp();
  std_msgs::Header header;
  model::Twists wrong = bent_;
  for (int k = -2; k <= 2; ++k) {
    header.stamp = stamp + ros::Duration(0.02 * k);
    wrong(0, 0) = bent_(0, 0) + 0.001 * k;  // the one of the picture's time is right
    eye_.publish(ros_bridge::toShapeMsg(header, "linear", wrong));
  }
  eye_.show(eye_.picture(bent_), stamp);
  const auto measured = VisionListener::of(eye_.measured, stamp);
  const auto error = VisionListener::of(eye_.errors, stamp);
  ASSERT_TRUE(measured && error);
  EXPECT_EQ(error->model_stamp, stamp);
  ASSERT_EQ(error->twist.size(), 6U);
  EXPECT_LT(
      (vectorOf(error->twist) - vectorOf(measured->twist) + Eigen::VectorXd(bent_.col(0))).norm(),
      1e-12);
  EXPECT_NEAR(error->tip_error, tipDistance(*measured, bent_), 1e-12);
  EXPECT_NEAR(error->tip_error_percent, 100 * error->tip_error / bent_.col(0).head<3>().norm(),
              1e-9);
  EXPECT_GT(error->tip_sigma, 0);
  EXPECT_GT(error->tag_rms, 0);
}

TEST_P(JpegEye, ACalibrationOtherThanTheScenesReplacesIt) {
  // With 2 % more focal length the same picture tells of an arm that is farther away; with the same
  // one it tells the same again.
  constexpr double kRepeatable = 1e-4, kOther = 5e-4;  // [m]
  const auto first = showAndMeasure(bent_), again = showAndMeasure(bent_);
  ASSERT_TRUE(first && again);
  const Eigen::Vector3d tip = ros_bridge::fromMsg(first->tip).translation;
  const auto moved = [&](const ArmShape& shape) {
    return (ros_bridge::fromMsg(shape.tip).translation - tip).norm();
  };
  EXPECT_LT(moved(*again), kRepeatable);
  auto info = eye_.info();
  info.K[0] *= 1.02;
  info.K[4] *= 1.02;
  eye_.publish(info);
  const cv::Mat picture = eye_.picture(bent_);
  double farthest = 0;
  EXPECT_TRUE(waitFor([&] {
    const ros::Time stamp = eye_.stamp();
    eye_.show(picture, stamp);
    const auto measured = VisionListener::of(eye_.measured, stamp, 1.0);
    if (measured) farthest = std::max(farthest, moved(*measured));
    return farthest > kOther;
  })) << "the tip moved by "
      << farthest << " m; " << lastStatus().message;
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

TEST(File, ItsEndIsTheLastState) {
  CameraStandIn& eye = StandIns::of("jpeg");
  const auto jpeg = eye.jpeg(eye.picture(eye.twists(kBent)), {}).data;
  const TemporaryFolder folder;
  std::ofstream(folder / "only.jpg", std::ios::binary)
      .write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size()));
  VisionListener listener("file");
  Process node({HELIX_ARM_VISION, "__ns:=file", "_scene:=demo", "_source:=" + folder / "only.jpg",
                "_file_rate:=1000", "_stale_after_s:=0.05", "_frame_prefix:=file_"});
  // One status a second: the last of these is long past ~stale_after_s.
  const auto ended = [&] {
    std::size_t count = 0;
    for (const auto& status : listener.status.all()) count += status->state == VisionStatus::ENDED;
    return count;
  };
  ASSERT_TRUE(waitFor([&] { return ended() >= 3; })) << node.output();
  bool over = false;
  for (const auto& status : listener.status.all()) {
    over = over || status->state == VisionStatus::ENDED;
    if (!over) continue;
    EXPECT_EQ(status->state, VisionStatus::ENDED) << status->message;
    EXPECT_EQ(status->measured, 1U);
  }
}

TEST(File, ItsPicturesAreRepublishedWithTheirIntrinsics) {
  CameraStandIn& eye = StandIns::of("jpeg");
  cv::Mat picture;
  const auto jpeg = eye.jpeg(eye.picture(eye.twists(kBent)), {}).data;
  vision::JpegDecoder().decode(jpeg.data(), jpeg.size(), picture);
  const TemporaryFolder folder;
  for (int i = 0; i < 400; ++i) {
    std::ofstream(folder / (std::to_string(1000 + i) + ".jpg"), std::ios::binary)
        .write(reinterpret_cast<const char*>(jpeg.data()),
               static_cast<std::streamsize>(jpeg.size()));
  }
  Process node({HELIX_ARM_VISION, "__ns:=shown", "_scene:=demo", "_source:=" + folder.path(),
                "_file_rate:=10", "_frame_prefix:=shown_", "_publish_image:=true"});
  VisionListener listener("shown");
  const Inbox<sensor_msgs::Image> image(listener.node, names::kImage);
  const Inbox<sensor_msgs::CameraInfo> info(listener.node, names::kCameraInfo);
  ASSERT_TRUE(waitFor([&] { return image.all().size() >= 2 && info.all().size() >= 2; }))
      << node.outputNow();
  const sensor_msgs::Image shown = image.last();
  const auto with = VisionListener::of(info, shown.header.stamp);
  ASSERT_NE(with, nullptr) << "no camera_info of the picture's time";
  EXPECT_EQ(with->header.frame_id, "shown_camera_optical");
  EXPECT_EQ(shown.header.frame_id, with->header.frame_id);
  const auto expected = ros_bridge::toCameraInfoMsg({}, eye.scene.camera->model);
  EXPECT_EQ(with->K, expected.K);
  EXPECT_EQ(with->D, expected.D);
  EXPECT_EQ(with->width, expected.width);
  EXPECT_EQ(shown.encoding, "mono8");
  cv::Mat buffer;
  const auto gray = ros_bridge::fromMsg(shown, buffer);
  ASSERT_TRUE(std::holds_alternative<cv::Mat>(gray));
  EXPECT_EQ(cv::norm(std::get<cv::Mat>(gray), picture, cv::NORM_INF), 0);
  ASSERT_NE(VisionListener::of(listener.detections, shown.header.stamp), nullptr);
}

// ---- Parts of nodes, each on its own ------------------------------------------------------------

// Poses that wait for a body that is lost are handed over one set at a time.
TEST(PoseSource, ALostBodyLeavesTheOthersInSetsOfOneTime) {
  ros::NodeHandle node("poses");
  const io::Scene scene = shippedScene("mocap");
  std::vector<ros_bridge::Picture> sets;
  std::vector<std::string> faults;
  ros_bridge::PoseOptions options;
  options.topics = "NAME/pose";
  const ros_bridge::PoseSource source(
      node, options, *scene.tags, [&](ros_bridge::Picture set) { sets.push_back(std::move(set)); },
      [&](const ros_bridge::PictureRefusal& refusal) { faults.push_back(refusal.message); });
  std::vector<ros::Publisher> publishers;
  for (const char* name : {"frame", "tip"}) {
    publishers.push_back(
        node.advertise<geometry_msgs::PoseStamped>(name + std::string("/pose"), 99));
    ASSERT_TRUE(waitFor([&] { return publishers.back().getNumSubscribers() == 1; }));
  }
  constexpr int kSets = 20;
  const auto send = [](const ros::Publisher& publisher, const ros::Time& stamp) {
    geometry_msgs::PoseStamped pose;
    pose.header.frame_id = "mocap";
    pose.header.stamp = stamp;
    pose.pose.orientation.w = 1;
    publisher.publish(pose);
  };
  // Each body in one go, as on a busy machine; later ones tell that time goes on.
  const ros::Time begin = ros::Time::now() - ros::Duration(0.1);
  for (const ros::Publisher& publisher : publishers) {
    for (int k = 0; k < kSets; ++k) send(publisher, begin + ros::Duration(0.005 * k));
  }
  ASSERT_TRUE(waitFor([&] {
    send(publishers.front(), ros::Time::now());
    return sets.size() >= kSets;
  }));
  EXPECT_EQ(faults, std::vector<std::string>());
  for (int k = 0; k < kSets; ++k) {
    const auto& set = std::get<ros_bridge::BodySet>(sets[static_cast<std::size_t>(k)].content);
    EXPECT_EQ(set.poses.size(), 2U) << k;
    EXPECT_EQ(set.frame, "mocap");
    if (k > 0) {
      EXPECT_LT(sets[k - 1U].stamp, sets[static_cast<std::size_t>(k)].stamp);
    }
  }
}

// A thread of the vision nodelet fails while the other finishes its picture.
TEST(VisionStatusPublisher, NoStateFollowsAFailure) {
  ros::NodeHandle node("failed_vision");
  Inbox<VisionStatus> statuses(node, names::kVisionStatus);
  const io::Scene scene = demo();
  ros_bridge::VisionStatusPublisher publisher(node, "vision", "arm_base", "topic");
  ASSERT_TRUE(waitFor([&] {
    publisher.report(scene);
    return !statuses.all().empty();
  }));
  publisher.enter(VisionStatus::MEASURED, "three tags");
  publisher.close("it has failed");
  publisher.enter(VisionStatus::MEASURED, "three tags");
  publisher.refuse({ros_bridge::PictureFault::kSource, "no camera"});
  publisher.enter(VisionStatus::ENDED, "the file has ended");
  publisher.report(scene);
  // Only the report tells of the fault that was counted last.
  ASSERT_TRUE(waitFor([&] { return statuses.last().source_faults == 1; }));
  EXPECT_EQ(statuses.last().state, VisionStatus::CAMERA_FAULT);
  EXPECT_EQ(statuses.last().message, "it has failed");
}

}  // namespace
}  // namespace helix_arm::test
