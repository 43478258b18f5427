// From pictures to what is measured in: messages, the one that waits, the model of its time.
#include "ros_bridge/vision/pictures.hpp"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ros_bridge/vision/observations.hpp"
#include "support/has.hpp"

namespace helix_arm::ros_bridge {
namespace {

const estimation::Camera kCamera{
    640, 480, 600.5, 599.5, 320.25, 239.75, {0.1, -0.2, 0.001, -0.002, 0.05, 0, 0, 0}};

// Colours that differ from pixel to pixel.
cv::Mat colours(int width, int height) {
  cv::Mat out(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      out.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(7 * x), static_cast<std::uint8_t>(5 * y),
                                 static_cast<std::uint8_t>(3 * x + 11 * y)};
    }
  }
  return out;
}

cv::Mat grayOf(const sensor_msgs::Image& image) {
  cv::Mat buffer;
  const auto taken = fromMsg(image, buffer);
  if (const auto* refusal = std::get_if<PictureRefusal>(&taken)) {
    ADD_FAILURE() << refusal->message;
    return {};
  }
  return std::get<cv::Mat>(taken).clone();
}

template <class Taken>
void expectRefusal(const Taken& taken, PictureFault fault, const char* word) {
  const auto* refusal = std::get_if<PictureRefusal>(&taken);
  ASSERT_NE(refusal, nullptr) << word;
  EXPECT_STREQ(nameOf(refusal->fault), nameOf(fault)) << word;
  EXPECT_TRUE(test::has(refusal->message, word));
  EXPECT_LT(refusal->message.size(), 400U);
}

TEST(Picture, ColoursBecomeTheSameGrayInEveryEncoding) {
  const cv::Mat bgr = colours(9, 6);
  cv::Mat gray, converted;
  cv::cvtColor(bgr, gray, cv::COLOR_BGR2GRAY);
  auto image = toImageMsg({}, bgr);
  EXPECT_EQ(cv::norm(grayOf(image), gray, cv::NORM_INF), 0);
  cv::cvtColor(bgr, converted, cv::COLOR_BGR2RGB);
  image = toImageMsg({}, converted);
  image.encoding = "rgb8";
  EXPECT_EQ(cv::norm(grayOf(image), gray, cv::NORM_INF), 0);
  for (const auto& [encoding, conversion] :
       {std::pair("bgra8", cv::COLOR_BGR2BGRA), std::pair("rgba8", cv::COLOR_BGR2RGBA)}) {
    cv::cvtColor(bgr, converted, conversion);
    image.encoding = encoding;
    image.step = static_cast<std::uint32_t>(converted.step);
    image.data.assign(converted.datastart, converted.dataend);
    EXPECT_EQ(cv::norm(grayOf(image), gray, cv::NORM_INF), 0) << encoding;
  }
}

TEST(Picture, RowsMayBePadded) {
  const cv::Mat bgr = colours(5, 3);
  sensor_msgs::Image image = toImageMsg({}, bgr);
  const auto tight = image;
  image.step += 7;
  image.data.assign(static_cast<std::size_t>(image.step) * image.height, 0);
  for (std::uint32_t row = 0; row < image.height; ++row) {
    std::copy_n(&tight.data[row * tight.step], tight.step, &image.data[row * image.step]);
  }
  EXPECT_EQ(cv::norm(grayOf(image), grayOf(tight), cv::NORM_INF), 0);
}

TEST(CameraInfo, AnInvalidCalibrationIsRefused) {
  using Info = sensor_msgs::CameraInfo;
  const struct {
    const char* word;
    void (*spoil)(Info& info);
  } kRows[] = {
      {"not calibrated", [](Info& i) { i = {}; }},
      {"is not valid", [](Info& i) { i.K[0] = -600; }},
      {"14 coefficients",
       [](Info& i) {
         i.D.assign(14, 0.1);
         i.distortion_model = "rational_polynomial";
       }},
      {"skew", [](Info& i) { i.K[1] = 12; }},
      {"far from the centre", [](Info& i) { i.K[2] = 0.24 * i.width; }},
      {"'equidistant'", [](Info& i) { i.distortion_model = "equidistant"; }},
      {"K transposed",
       [](Info& i) {
         std::swap(i.K[2], i.K[6]);
         std::swap(i.K[5], i.K[7]);
       }},
      {"binning", [](Info& i) { i.binning_x = 2; }},
      {"region", [](Info& i) { i.roi.x_offset = 10; }},
  };
  for (const auto& row : kRows) {
    Info info = toCameraInfoMsg({}, kCamera);
    row.spoil(info);
    expectRefusal(fromMsg(info), PictureFault::kBadCameraInfo, row.word);
  }
}

Picture pictureAt(double seconds) { return {ros::Time(seconds), cv::Mat()}; }

TEST(PictureMailbox, ANewerPictureReplacesTheOneThatWaits) {
  PictureMailbox mailbox;
  EXPECT_FALSE(mailbox.put(pictureAt(1)));
  EXPECT_TRUE(mailbox.put(pictureAt(2)));
  EXPECT_EQ(mailbox.take().value().stamp, ros::Time(2));
  // The one that is measured is not replaced.
  EXPECT_FALSE(mailbox.put(pictureAt(3)));
}

class History : public ::testing::Test {
 protected:
  // A model whose first number tells which one it is.
  void add(double seconds, double mark) {
    history_.add(ros::Time(seconds), model::Twists(model::Twists::Constant(6, 1, mark)));
  }
  double markAt(double seconds) const {
    const auto entry = history_.nearest(ros::Time(seconds));
    return entry ? entry->shape.pieces()(0, 0) : -1.0;
  }

  ModelHistory history_;
};

TEST_F(History, TheNearestInTimeIsTaken) {
  add(10.0, 1);
  add(10.1, 2);
  add(10.2, 3);
  EXPECT_EQ(markAt(10.04), 1);
  EXPECT_EQ(markAt(10.06), 2);
  EXPECT_EQ(markAt(10.14), 2);
  EXPECT_EQ(markAt(10.3), 3);
}

TEST_F(History, BeyondItsReachThereIsNone) {
  EXPECT_EQ(markAt(10.0), -1);
  add(10.0, 1);
  EXPECT_EQ(markAt(10.0 + 0.99 * ModelHistory::kReach), 1);
  EXPECT_EQ(markAt(10.0 + 1.01 * ModelHistory::kReach), -1);
  EXPECT_EQ(markAt(10.0 - 1.01 * ModelHistory::kReach), -1);
}

TEST_F(History, AJumpBackInTimeForgetsWhatWasAhead) {
  add(10.0, 1);
  add(5.0, 2);
  EXPECT_EQ(markAt(10.0), -1);
  EXPECT_EQ(markAt(5.0), 2);
}

TEST_F(History, ANearerModelMayComeUntilOneIsAsLate) {
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(10.0)));  // none comes at all
  add(9.9, 1);
  EXPECT_TRUE(history_.mayGetNearer(ros::Time(10.0)));
  add(10.0, 2);
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(10.0)));
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(20.0)));  // they stopped coming
}

}  // namespace
}  // namespace helix_arm::ros_bridge
