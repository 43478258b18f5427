// From pictures to what is measured in: messages, the one that waits, the model of its time.
#include "ros_bridge/vision/pictures.hpp"

#include <future>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ros_bridge/vision/observations.hpp"
#include "support/has.hpp"

namespace helix_arm::ros_bridge {
namespace {

using std::chrono::steady_clock;

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

TEST(Picture, BayerPatternsAreNamedByTheirFirstPixels) {
  // One colour all over, in the mosaic's own values: red 200, green 100, blue 50.
  const double expected = 0.299 * 200 + 0.587 * 100 + 0.114 * 50;
  for (const std::string pattern : {"rggb", "bggr", "gbrg", "grbg"}) {
    cv::Mat mosaic(8, 8, CV_8UC1);
    for (int y = 0; y < 8; ++y) {
      for (int x = 0; x < 8; ++x) {
        const char c = pattern[2 * (y % 2) + x % 2];
        mosaic.at<std::uint8_t>(y, x) = c == 'r' ? 200 : c == 'g' ? 100 : 50;
      }
    }
    auto image = toImageMsg({}, mosaic);
    image.encoding = "bayer_" + pattern + "8";
    const cv::Mat gray = grayOf(image);
    ASSERT_FALSE(gray.empty());
    EXPECT_NEAR(gray.at<std::uint8_t>(4, 4), expected, 1.0) << pattern;
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

TEST(Picture, OnlyJpegIsDecoded) {
  vision::JpegDecoder decoder;
  cv::Mat buffer;
  sensor_msgs::CompressedImage image;
  const auto faultOf = [&] {
    return std::get<PictureRefusal>(fromMsg(image, decoder, buffer)).fault;
  };
  image.data = vision::JpegEncoder(90).encode(cv::Mat(16, 16, CV_8UC1, cv::Scalar(99)));
  for (const char* format : {"", "jpeg", "JPG", "mono8; jpeg compressed mono8"}) {
    image.format = format;
    EXPECT_TRUE(std::holds_alternative<cv::Mat>(fromMsg(image, decoder, buffer))) << format;
  }
  image.format = "bgr8; png compressed bgr8";
  EXPECT_EQ(faultOf(), PictureFault::kWrongEncoding);
  image.format = "jpeg";
  image.data.resize(image.data.size() / 2);
  EXPECT_EQ(faultOf(), PictureFault::kBadJpeg);
  image.data.clear();
  EXPECT_EQ(faultOf(), PictureFault::kBadJpeg);
}

TEST(CameraInfo, SurvivesTheRoundTrip) {
  estimation::Camera rational = kCamera;
  rational.distortion = {0.1, -0.2, 0.001, -0.002, 0.05, 0.3, -0.1, 0.02};
  estimation::Camera pinhole = kCamera;
  pinhole.distortion = {};
  for (const estimation::Camera& camera : {kCamera, rational, pinhole}) {
    const auto taken = fromMsg(toCameraInfoMsg({}, camera));
    ASSERT_TRUE(std::holds_alternative<estimation::Camera>(taken));
    EXPECT_TRUE(equal(std::get<estimation::Camera>(taken), camera));
  }
  EXPECT_FALSE(equal(kCamera, rational));
}

TEST(CameraInfo, AnInvalidCalibrationIsRefused) {
  using Info = sensor_msgs::CameraInfo;
  const struct {
    const char* word;
    void (*spoil)(Info& info);
  } kRows[] = {
      {"K = 0", [](Info& i) { i.K.fill(0); }},
      {"not calibrated", [](Info& i) { i = {}; }},
      {"is not valid", [](Info& i) { i.K[0] = -600; }},
      {"is not valid", [](Info& i) { i.K[2] = std::nan(""); }},
      {"is not valid", [](Info& i) { i.width = 0; }},
      {"'equidistant'", [](Info& i) { i.distortion_model = "equidistant"; }},
      {"14 coefficients",
       [](Info& i) {
         i.D.assign(14, 0.1);
         i.distortion_model = "rational_polynomial";
       }},
      {"'rational_polynomial' with 5 coefficients",
       [](Info& i) { i.distortion_model = "rational_polynomial"; }},
      {"'plumb_bob' with 3 coefficients", [](Info& i) { i.D.resize(3); }},
      {"skew", [](Info& i) { i.K[1] = 12; }},
      {"K transposed",
       [](Info& i) {
         std::swap(i.K[2], i.K[6]);
         std::swap(i.K[5], i.K[7]);
       }},
      {"K[8] = 0", [](Info& i) { i.K[8] = 0; }},
      {"far from the centre", [](Info& i) { i.K[2] = 0.24 * i.width; }},
      {"far from the centre", [](Info& i) { i.K[5] = 0.76 * i.height; }},
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

// That an answer is not there yet, and that it comes: how long these are waited for.
template <class T>
bool waits(std::future<T>& answer) {
  return answer.wait_for(std::chrono::milliseconds(20)) == std::future_status::timeout;
}
constexpr std::chrono::seconds kLong(20);
template <class T>
T came(std::future<T>& answer) {
  EXPECT_EQ(answer.wait_for(kLong), std::future_status::ready);
  return answer.get();
}

TEST(PictureMailbox, ANewerPictureReplacesTheOneThatWaits) {
  PictureMailbox mailbox;
  EXPECT_FALSE(mailbox.put(pictureAt(1)));
  EXPECT_TRUE(mailbox.put(pictureAt(2)));
  EXPECT_EQ(mailbox.take().value().stamp, ros::Time(2));
  // The one that is measured is not replaced.
  EXPECT_FALSE(mailbox.put(pictureAt(3)));
}

TEST(PictureMailbox, IdleIsWhenNoneWaitsAndTheLastIsDone) {
  PictureMailbox mailbox;
  EXPECT_TRUE(mailbox.waitUntilIdle());
  mailbox.put(pictureAt(1));
  auto idle = std::async(std::launch::async, [&] { return mailbox.waitUntilIdle(); });
  EXPECT_TRUE(waits(idle));
  mailbox.take();
  EXPECT_TRUE(waits(idle));
  mailbox.done();
  EXPECT_TRUE(came(idle));
}

TEST(PictureMailbox, StoppingEndsAllWaits) {
  PictureMailbox mailbox;
  auto taken = std::async(std::launch::async, [&] { return mailbox.take().has_value(); });
  auto slept = std::async(std::launch::async,
                          [&] { return mailbox.sleepUntil(steady_clock::now() + 2 * kLong); });
  EXPECT_TRUE(waits(taken) && waits(slept));
  mailbox.stop();
  EXPECT_FALSE(came(taken) || came(slept));
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

TEST_F(History, APictureFromBeforeForgetsModelsFromBeforeTheJump) {
  add(5.0, 1);
  add(6.0, 2);
  history_.forgetFuture(ros::Time(5.1));
  EXPECT_EQ(markAt(5.1), 1);
  EXPECT_EQ(markAt(6.0), -1);
}

TEST_F(History, ANearerModelMayComeUntilOneIsAsLate) {
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(10.0)));  // none comes at all
  add(9.9, 1);
  EXPECT_TRUE(history_.mayGetNearer(ros::Time(10.0)));
  add(10.0, 2);
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(10.0)));
  EXPECT_FALSE(history_.mayGetNearer(ros::Time(20.0)));  // they stopped coming
}

TEST_F(History, TheLagIsOfTheLatestModel) {
  EXPECT_FALSE(history_.lag(ros::Time(10.0)));
  add(9.0, 1);
  add(9.5, 2);
  EXPECT_NEAR(*history_.lag(ros::Time(10.0)), 0.5, 1e-9);
  EXPECT_NEAR(*history_.lag(ros::Time(9.0)), -0.5, 1e-9);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
