#include "camera.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::simulation {
namespace {

constexpr double kFarOff = 2e4;  // limit of pixel coordinates that are drawn [px]

// A number in [lower, upper) from a generator. It is the same on every machine, which the
// distributions of the standard library do not guarantee.
template <class Generator>
double uniform(Generator& generator, double lower, double upper) {
  const double span = static_cast<double>(Generator::max() - Generator::min()) + 1.0;
  return lower + (upper - lower) * (static_cast<double>(generator() - Generator::min()) / span);
}

constexpr int kFractionBits = 4;  // of OpenCV's fixed-point coordinates

// Fills a quadrangle, its corners in pixels, with smooth edges.
void fillQuadrangle(cv::Mat& picture, const cv::Point2d (&corners)[4], double gray) {
  cv::Point fixed[4];
  const double scale = 1 << kFractionBits;
  for (int i = 0; i < 4; ++i) {
    fixed[i] = {static_cast<int>(std::lround(corners[i].x * scale)),
                static_cast<int>(std::lround(corners[i].y * scale))};
  }
  cv::fillConvexPoly(picture, fixed, 4, cv::Scalar(gray), cv::LINE_AA, kFractionBits);
}

// A frame in the picture for drawing.
struct Place {
  cv::Point2d center;
  cv::Point2d right;  // of unit length

  cv::Point2d at(double x, double y) const {
    return {center.x + x * right.x - y * right.y, center.y + x * right.y + y * right.x};
  }
};

void fillBox(cv::Mat& picture, const Place& place, double x, double y, double half_width,
             double half_height, double gray) {
  const cv::Point2d corners[] = {
      place.at(x - half_width, y - half_height), place.at(x + half_width, y - half_height),
      place.at(x + half_width, y + half_height), place.at(x - half_width, y + half_height)};
  fillQuadrangle(picture, corners, gray);
}

// Looks like the border of a tag; its four-fold symmetry is one that no tag of any family has.
void paintMockTag(cv::Mat& picture, const Place& place, double half, bool hollow) {
  fillBox(picture, place, 0, 0, 1.3 * half, 1.3 * half, 225);
  fillBox(picture, place, 0, 0, half, half, 35);
  if (hollow) fillBox(picture, place, 0, 0, 0.5 * half, 0.5 * half, 215);
}

void paintCheckerboard(cv::Mat& picture, const Place& place, double half) {
  constexpr int kCells = 5;
  fillBox(picture, place, 0, 0, 1.2 * half, 1.2 * half, 230);
  const double cell = 2 * half / kCells;
  for (int i = 0; i < kCells * kCells; i += 2) {
    fillBox(picture, place, (i % kCells + 0.5) * cell - half, (i / kCells + 0.5) * cell - half,
            0.5 * cell, 0.5 * cell, 40);
  }
}

// The background (CV_8UC1): soft light and `clutter` objects with edges as of tags and arms.
cv::Mat paintBackdrop(int width, int height, int clutter, std::uint32_t seed) {
  cv::Mat picture(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    uchar* row = picture.ptr<uchar>(y);
    for (int x = 0; x < width; ++x) {
      const double across = static_cast<double>(x) / width, down = static_cast<double>(y) / height;
      row[x] = static_cast<uchar>(std::lround(
          168 - 22 * down - 40 * ((across - 0.4) * (across - 0.4) + (down - 0.3) * (down - 0.3))));
    }
  }
  std::mt19937 generator(seed);
  enum Kind { kBox, kMockTag, kLine, kHollowMockTag, kCheckerboard, kKinds };
  for (int i = 0; i < clutter; ++i) {
    Place place;
    place.center.x = uniform(generator, 0, width);
    place.center.y = uniform(generator, 0, height);
    const double angle = uniform(generator, 0, 2 * CV_PI);
    place.right = {std::cos(angle), std::sin(angle)};
    const double size = uniform(generator, 0.02, 0.06) * width;
    const double stretch = uniform(generator, 0.5, 2.0);
    const double gray = uniform(generator, 60, 210);
    switch (i % kKinds) {
      case kBox:
        fillBox(picture, place, 0, 0, size, size * stretch, gray);
        break;
      case kMockTag:
      case kHollowMockTag:
        paintMockTag(picture, place, 0.4 * size, i % kKinds == kHollowMockTag);
        break;
      case kLine:
        fillBox(picture, place, 0, 0, 5 * size, 0.03 * size * stretch, gray);
        break;
      default:
        paintCheckerboard(picture, place, 0.7 * size);
        break;
    }
  }
  return picture;
}

constexpr double kWander = 0.4;  // of a bar from the middle, relative to the picture

// A bar that moves in front of all else; in fractions of the picture and radians per picture.
struct Occluder {
  double x_rate, x_phase, y_rate, y_phase, turn_rate, turn_phase, half_width, half_length, gray;

  explicit Occluder(std::mt19937& generator) {
    for (const auto& [rate, phase] :
         {std::pair{&x_rate, &x_phase}, {&y_rate, &y_phase}, {&turn_rate, &turn_phase}}) {
      const double speed = uniform(generator, 0.015, 0.05);
      *rate = uniform(generator, -1, 1) < 0 ? -speed : speed;
      *phase = uniform(generator, 0, 2 * CV_PI);
    }
    half_width = uniform(generator, 0.02, 0.04);
    half_length = uniform(generator, 0.2, 0.4);
    gray = uniform(generator, 50, 120);
  }

  // Draws it at its position in picture number t.
  void draw(double t, cv::Mat& picture) const {
    const double width = picture.cols, height = picture.rows;
    const double angle = turn_rate * t + turn_phase;
    const Place place{{width * (0.5 + kWander * std::sin(x_rate * t + x_phase)),
                       height * (0.5 + kWander * std::sin(y_rate * t + y_phase))},
                      {std::cos(angle), std::sin(angle)}};
    fillBox(picture, place, 0, 0, half_length * height, half_width * height, gray);
  }
};

constexpr double kOutside = 1e4;  // beyond all points in use [units]

// The cells that a strip between two lines overlaps.
struct Strip {
  int first, last;
};

// A strip around every line between cells, as wide as the border shift on both sides, is white if
// either cell is. The outermost strips are the surroundings of the card.
struct Strips {
  std::vector<Strip> cells;
  std::vector<double> lines;  // where they begin and end
};

Strips stripsOf(const std::vector<double>& widths, double border_shift) {
  Strips strips{{{-1, -1}}, {-kOutside, 0.0}};
  const int size = static_cast<int>(widths.size());
  double line = 0;
  for (int i = 0; i < size; ++i) {
    line += widths[static_cast<std::size_t>(i)];
    strips.cells.push_back({i, i});
    if (i + 1 == size) break;
    if (border_shift > 0) {
      strips.lines.push_back(line - border_shift);
      strips.cells.push_back({i, i + 1});
    }
    strips.lines.push_back(line + border_shift);
  }
  strips.cells.push_back({-1, -1});
  strips.lines.push_back(line);
  strips.lines.push_back(kOutside);
  return strips;
}

// Black and white areas of a printed card, such as a tag with its quiet zone.
//
// Coordinates are in units of the print from the top left corner of the card, x to the right and y
// down as one reads the tag. Lines that cross the card divide it into rectangles of one colour.
class TagPattern {
 public:
  // A point of the plane and its rectangle.
  struct Point {
    double x, y;      // [units]
    int column, row;  // of the rectangle that contains it
  };

  // Contour integrals along a line; around an area they sum to the area itself [units^2]: the white
  // area, that on the card, and the whole.
  using Areas = Eigen::Array3d;

  // @param border_shift  of white into black at each edge, >= 0, less than half the least cell
  // [units].
  TagPattern(const CardPrint& print, double border_shift) {
    Strips across = stripsOf(print.across, border_shift), down = stripsOf(print.down, border_shift);
    across_ = std::move(across.lines);
    down_ = std::move(down.lines);
    columns_ = across.cells.size();
    const cv::Mat& cells = print.cells;
    rectangles_.reserve(down.cells.size() * columns_);
    for (const Strip& row : down.cells) {
      double white_before = 0, card_before = 0;
      for (std::size_t column = 0; column < columns_; ++column) {
        const Strip& here = across.cells[column];
        const bool card = here.first >= 0 && row.first >= 0;
        const bool white = card && (cells.at<uchar>(row.first, here.first) != 0 ||
                                    cells.at<uchar>(row.first, here.last) != 0 ||
                                    cells.at<uchar>(row.last, here.first) != 0 ||
                                    cells.at<uchar>(row.last, here.last) != 0);
        rectangles_.push_back({white ? 1.0 : 0.0, card ? 1.0 : 0.0, white_before, card_before});
        const double width = across_[column + 1] - across_[column];
        if (white) white_before += width;
        if (card) card_before += width;
      }
    }
  }

  // The point at (x, y), |x| and |y| at most 1e3; `hint` is a point near it.
  Point at(double x, double y, const Point& hint) const {
    const auto find = [](const std::vector<double>& lines, double value, int i) {
      while (value < lines[i]) --i;
      while (value >= lines[i + 1]) ++i;
      return i;
    };
    return {x, y, find(across_, x, hint.column), find(down_, y, hint.row)};
  }

  // Along the straight line from a to b.
  // By Green's theorem, an area is the integral of x dy around it; its white part is the integral
  // of the white width to the left of the contour. Both are linear in x within a rectangle, so the
  // midpoint of each piece of the line gives its integral.
  Areas along(const Point& a, const Point& b) const {
    const double dx = b.x - a.x, dy = b.y - a.y;
    Areas areas(0, 0, 0.5 * (a.x + b.x) * dy);
    const auto crossing = [](const std::vector<double>& lines, double from, double step, int i) {
      if (step > 0) return (lines[i + 1] - from) / step;
      if (step < 0) return (lines[i] - from) / step;
      return std::numeric_limits<double>::infinity();
    };
    int column = a.column, row = a.row;
    for (double begin = 0.0;;) {
      double end = 1.0;
      bool sideways = false;
      if (column != b.column || row != b.row) {
        const double across = crossing(across_, a.x, dx, column);
        const double down = crossing(down_, a.y, dy, row);
        sideways = across <= down;
        end = std::min(1.0, sideways ? across : down);
      }
      const Rectangle& here = rectangles_[static_cast<std::size_t>(row) * columns_ + column];
      const double into = a.x + 0.5 * (begin + end) * dx - across_[column];
      const double height = (end - begin) * dy;
      areas[0] += (here.white_before + here.white * into) * height;
      areas[1] += (here.card_before + here.card * into) * height;
      if (!(end < 1.0)) return areas;
      begin = end;
      if (sideways) {
        column += dx > 0 ? 1 : -1;
      } else {
        row += dy > 0 ? 1 : -1;
      }
    }
  }

 private:
  struct Rectangle {
    double white, card;                // 0 or 1
    double white_before, card_before;  // widths in this row on its left
  };

  std::vector<double> across_, down_;  // (count + 1) where the rectangles begin
  std::size_t columns_;                // of rectangles
  std::vector<Rectangle> rectangles_;  // by rows
};

using Areas = TagPattern::Areas;

// Gray levels of paper and ink in full light.
constexpr double kWhite = 222, kBlack = 34;
// Light on a face that is turned away from the camera, which carries the light source.
constexpr double kAmbientLight = 0.65;
constexpr double kMostUnits = 1e3;      // from a card's corner to a pixel that may show it
constexpr int kOutlinePoints = 8;       // per side of a card, which distortion bends
constexpr double kOutlineMargin = 2.0;  // error of the outline between these points [px]

cv::Mat directionsAtPixelCorners(const estimation::Camera& camera) {
  cv::Mat out(camera.height + 1, camera.width + 1, CV_32FC2);
  const float unseen = std::numeric_limits<float>::quiet_NaN();
  for (int y = 0; y < out.rows; ++y) {
    auto* row = out.ptr<cv::Vec2f>(y);
    for (int x = 0; x < out.cols; ++x) {
      const auto direction = camera.directionOf({x - 0.5, y - 0.5});
      row[x] = direction ? cv::Vec2f(static_cast<float>(direction->x()),
                                     static_cast<float>(direction->y()))
                         : cv::Vec2f(unseen, unseen);
    }
  }
  return out;
}

// Paints the mean of the card over a pixel, mixed with the background if it covers only a part.
void paintPixel(const Areas& areas, double light, uchar& pixel) {
  if (areas[2] == 0) return;
  const double card = std::clamp(areas[1] / areas[2], 0.0, 1.0);
  const double white = std::clamp(areas[0] / areas[2], 0.0, card);
  const double gray = light * (kWhite * white + kBlack * (card - white)) + (1 - card) * pixel;
  pixel = static_cast<uchar>(gray + 0.5);
}

// Paints flat cards, such as the tags of an arm, as a camera with distortion sees them. Each pixel
// is computed from the exact area of the card that it covers.
class TagPainter {
 public:
  // @param border_shift  width by which white bleeds into black at each edge [m].
  // @throws std::invalid_argument on a border shift of half a cell or more.
  TagPainter(const estimation::Camera& camera, const std::vector<CardPrint>& prints,
             double border_shift)
      : camera_(camera), directions_(directionsAtPixelCorners(camera)) {
    for (const CardPrint& print : prints) {
      const double least = std::min(*std::min_element(print.across.begin(), print.across.end()),
                                    *std::min_element(print.down.begin(), print.down.end()));
      basics::requireValue(border_shift < 0.5 * least * print.unit, "simulated camera",
                           "the bleed [m]", border_shift,
                           "less than half a cell of what is printed");
      cards_.push_back({TagPattern(print, border_shift / print.unit), print.unit,
                        std::accumulate(print.across.begin(), print.across.end(), 0.0),
                        std::accumulate(print.down.begin(), print.down.end(), 0.0)});
    }
  }

  // Paints a card over a picture (CV_8UC1) of the camera's size.
  // @param X_CT  its pose seen from the camera: origin in its centre, as of a tag.
  // The corners of every pixel are projected onto the card's plane, and the quadrangle between them
  // is integrated exactly. Pixels tile the plane, so edges are not displaced and no area is lost;
  // each line between two pixels is integrated once.
  void draw(int number, const lie::SE3& X_CT, cv::Mat& picture) {
    const Card& card = cards_[static_cast<std::size_t>(number)];
    const TagPattern& pattern = card.pattern;
    const cv::Rect box = boxOf(card, X_CT);
    if (box.empty()) return;

    Eigen::Matrix3d direction_of_units;
    direction_of_units.col(0) = card.unit * X_CT.rotation.col(0);
    direction_of_units.col(1) = -card.unit * X_CT.rotation.col(1);  // rows run downwards
    direction_of_units.col(2) =
        X_CT.translation -
        0.5 * card.width *
            (direction_of_units.col(0) + card.height / card.width * direction_of_units.col(1))
                .eval();
    const Eigen::Matrix3d units_of_direction = direction_of_units.inverse();
    const double facing = -X_CT.rotation.col(2).dot(X_CT.translation) / X_CT.translation.norm();
    const double light = kAmbientLight + (1 - kAmbientLight) * facing;

    const auto lineBetween = [&pattern](const PlanePoint& a, const PlanePoint& b) {
      return a.valid && b.valid ? pattern.along(a.point, b.point) : Areas(Areas::Zero());
    };
    const std::size_t corners = static_cast<std::size_t>(box.width) + 1;
    for (auto* points : {&above_, &below_}) points->resize(std::max(points->size(), corners));
    for (auto* lines : {&lines_above_, &lines_below_})
      lines->resize(std::max(lines->size(), corners));

    for (int y = box.y; y <= box.y + box.height; ++y) {
      lookThrough(y, box, units_of_direction, pattern, below_);
      for (int i = 0; i < box.width; ++i) lines_below_[i] = lineBetween(below_[i], below_[i + 1]);
      if (y > box.y) {
        uchar* row = picture.ptr<uchar>(y - 1) + box.x;
        Areas left = lineBetween(above_[0], below_[0]);
        for (int i = 0; i < box.width; ++i) {
          const Areas right = lineBetween(above_[i + 1], below_[i + 1]);
          if (above_[i].valid && above_[i + 1].valid && below_[i].valid && below_[i + 1].valid) {
            paintPixel(lines_above_[i] + right - lines_below_[i] - left, light, row[i]);
          }
          left = right;
        }
      }
      std::swap(above_, below_);
      std::swap(lines_above_, lines_below_);
    }
  }

 private:
  // Intersection of the ray through a pixel's corner with a card's plane.
  struct PlanePoint {
    bool valid = false;
    TagPattern::Point point{};
  };

  struct Card {
    TagPattern pattern;
    double unit;           // [m]
    double width, height;  // [units]
  };

  cv::Rect boxOf(const Card& card, const lie::SE3& X_CT) const {
    const cv::Rect whole(0, 0, camera_.width, camera_.height);
    const Eigen::Vector3d half(0.5 * card.width * card.unit, 0.5 * card.height * card.unit, 0);
    Eigen::Vector2d least = Eigen::Vector2d::Constant(kFarOff), most = -least;
    for (int i = 0; i < 4 * kOutlinePoints; ++i) {
      const double along = 2.0 * (i % kOutlinePoints) / kOutlinePoints - 1;
      const Eigen::Vector3d side[] = {
          {along, -1, 0}, {1, along, 0}, {-along, 1, 0}, {-1, -along, 0}};
      const auto pixel = camera_.project(X_CT * half.cwiseProduct(side[i / kOutlinePoints]));
      if (!pixel) return whole;  // it extends beyond what the camera can see
      least = least.cwiseMin(*pixel);
      most = most.cwiseMax(*pixel);
    }
    least = (least.array() - kOutlineMargin).max(-1.0);
    most = (most.array() + kOutlineMargin).min(kFarOff);
    if (!(least.x() < whole.width && least.y() < whole.height && most.x() >= 0 && most.y() >= 0)) {
      return {};
    }
    const cv::Point first(static_cast<int>(std::floor(least.x())),
                          static_cast<int>(std::floor(least.y())));
    const cv::Point last(static_cast<int>(std::ceil(most.x())),
                         static_cast<int>(std::ceil(most.y())));
    return cv::Rect(first, last + cv::Point(1, 1)) & whole;
  }

  void lookThrough(int y, const cv::Rect& box, const Eigen::Matrix3d& units_of_direction,
                   const TagPattern& pattern, std::vector<PlanePoint>& out) const {
    const auto* direction = directions_.ptr<cv::Vec2f>(y) + box.x;
    TagPattern::Point hint{};
    for (int i = 0; i <= box.width; ++i) {
      const Eigen::Vector3d h =
          units_of_direction * Eigen::Vector3d(direction[i][0], direction[i][1], 1.0);
      const double reach = kMostUnits * h.z();  // negative behind the camera
      out[i].valid = std::abs(h.x()) < reach && std::abs(h.y()) < reach;
      if (!out[i].valid) continue;
      hint = pattern.at(h.x() / h.z(), h.y() / h.z(), hint);
      out[i].point = hint;
    }
  }

  estimation::Camera camera_;
  cv::Mat directions_;  // (CV_32FC2) (x/z, y/z) seen at the corners of the pixels
  std::vector<Card> cards_;
  // Edges of the current card.
  std::vector<PlanePoint> above_, below_;
  std::vector<TagPattern::Areas> lines_above_, lines_below_;
};

using estimation::ArmView;

constexpr double kLeastCosine = 0.02;  // of the angle of a face that is still drawn

// The arm is drawn as bands from rim to middle, with light from the left.
struct Band {
  double left, right;  // relative to half the width
  double gray;
};
constexpr std::array<Band, 5> kBands = {
    {{-1.0, 1.0, 62}, {-0.88, 0.82, 84}, {-0.72, 0.55, 104}, {-0.55, 0.2, 122}, {-0.4, -0.1, 136}}};
constexpr double kRingGray = 0.9;  // of every other piece of the arm, which gives it rings
constexpr int kPiecesPerSection = 32;
constexpr double kUsualRadius = 0.03;  // [m]

constexpr int kNoiseTable = 1 << 16;
constexpr double kBlurReach = 3.5;  // standard deviations

struct ArmNode {
  bool seen = false;
  cv::Point2d pixel;
  double per_metre = 0;  // focal length / depth [px/m]
  double depth = 0;      // [m]
};

// An object to draw; the farthest first.
struct Layer {
  double depth;  // [m]
  int tag;       // -1: a piece of the arm
  int piece;
};

// Each tag with its white border; the unit is a cell.
std::vector<CardPrint> printsOf(const estimation::TagLayout& layout,
                                const vision::TagFamily& family) {
  std::vector<CardPrint> prints;
  for (const estimation::TagPlacement& tag : layout.tags) {
    CardPrint print{family.cells(tag.id), {}, {}, layout.size / family.borderCells()};
    print.across.assign(static_cast<std::size_t>(print.cells.cols), 1.0);
    print.down.assign(static_cast<std::size_t>(print.cells.rows), 1.0);
    prints.push_back(std::move(print));
  }
  return prints;
}

// Includes 0.5, so that truncation becomes rounding.
std::vector<float> noiseTable(double deviation, std::uint32_t seed, int width) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  std::vector<float> table(kNoiseTable);
  for (float& value : table) value = static_cast<float>(0.5 + deviation * normal(generator));
  // A row may begin anywhere in the table.
  for (int x = 0; x < width; ++x) table.push_back(table[x]);
  return table;
}

}  // namespace

struct SimulatedCamera::Workspace {
  Workspace(const ArmView& view_in, const std::vector<CardPrint>& prints, const ArmBody& body_in,
            const SimulatedCameraConfig& config_in)
      : view(view_in),
        body(body_in),
        config(config_in),
        tags(view.camera, prints, config.border_shift),
        generator(config.seed) {
    for (int i = 0; i < config.occluders; ++i) occluders.emplace_back(generator);
    const estimation::Camera& camera = view.camera;
    backdrop = paintBackdrop(camera.width, camera.height, config.clutter, config.seed);
    noise = noiseTable(config.noise, config.seed, camera.width);
    picture.create(camera.height, camera.width, CV_8UC1);
  }

  const cv::Mat& render(const model::Shape& shape) {
    backdrop.copyTo(sharp);
    collectLayers(shape);
    for (const Layer& layer : layers) {
      if (layer.tag < 0) {
        drawPiece(layer.piece);
      } else {
        tags.draw(layer.tag, tag_poses[layer.tag], sharp);
      }
    }
    for (const Occluder& bar : occluders) bar.draw(picture_number, sharp);
    if (config.blur > 0) {
      const int reach = std::max(1, static_cast<int>(std::ceil(kBlurReach * config.blur)));
      cv::GaussianBlur(sharp, blurred, cv::Size(2 * reach + 1, 2 * reach + 1), config.blur,
                       config.blur, cv::BORDER_REPLICATE);
    }
    develop();
    ++picture_number;
    return picture;
  }

  void collectLayers(const model::Shape& shape) {
    layers.clear();
    tag_poses = estimation::tagPoses(view.layout, shape);
    for (std::size_t i = 0; i < tag_poses.size(); ++i) {
      lie::SE3& X_CT = tag_poses[i];
      X_CT = view.X_CB * X_CT;
      const double depth = X_CT.translation.norm();
      if (-X_CT.rotation.col(2).dot(X_CT.translation) < kLeastCosine * depth) continue;
      layers.push_back({depth, static_cast<int>(i), -1});
    }

    const auto curve = model::sampleToTip(shape, kPiecesPerSection * view.sections + 1);
    nodes.assign(curve.size(), {});
    for (std::size_t i = 0; i < curve.size(); ++i) {
      const Eigen::Vector3d p_C = view.X_CB * curve[i].X.translation;
      const auto pixel = view.camera.project(p_C);
      nodes[i].depth = p_C.norm();
      if (!pixel || !(pixel->cwiseAbs().maxCoeff() < kFarOff)) continue;
      nodes[i].seen = true;
      nodes[i].pixel = {pixel->x(), pixel->y()};
      nodes[i].per_metre = view.camera.fx / p_C.z();
    }
    for (int i = 0; i + 1 < static_cast<int>(nodes.size()); ++i) {
      if (!nodes[i].seen || !nodes[i + 1].seen) continue;
      // Its depth is that of its far side: tags on its near side and beside it are drawn later.
      layers.push_back({0.5 * (nodes[i].depth + nodes[i + 1].depth) + radiusOf(i), -1, i});
    }
    std::sort(layers.begin(), layers.end(),
              [](const Layer& a, const Layer& b) { return a.depth > b.depth; });
  }

  void drawPiece(int piece) {
    const ArmNode& from = nodes[piece];
    const ArmNode& to = nodes[piece + 1];
    // Direction across the arm at each end, from the neighbours, so that pieces join without gaps.
    const double radius = radiusOf(piece);
    const auto across = [this, radius](int i) {
      const int last = static_cast<int>(nodes.size()) - 1;
      const ArmNode& before = nodes[std::max(0, i - 1)].seen ? nodes[std::max(0, i - 1)] : nodes[i];
      const ArmNode& after =
          nodes[std::min(last, i + 1)].seen ? nodes[std::min(last, i + 1)] : nodes[i];
      const cv::Point2d along = after.pixel - before.pixel;
      const double length = std::hypot(along.x, along.y);
      const double scale = length > 0 ? radius * nodes[i].per_metre / length : 0.0;
      return cv::Point2d(-along.y * scale, along.x * scale);
    };
    const cv::Point2d across_from = across(piece), across_to = across(piece + 1);
    const double tone = piece % 2 == 0 ? 1.0 : kRingGray;
    for (const Band& band : kBands) {
      const cv::Point2d corners[] = {
          from.pixel + band.left * across_from, from.pixel + band.right * across_from,
          to.pixel + band.right * across_to, to.pixel + band.left * across_to};
      fillQuadrangle(sharp, corners, tone * band.gray);
    }
  }

  double radiusOf(int piece) const {
    if (body.radius.empty()) return kUsualRadius;
    return body.radius[std::min(piece / kPiecesPerSection, view.sections - 1)];
  }

  void develop() {
    const cv::Mat& light = config.blur > 0 ? blurred : sharp;
    const auto gain = static_cast<float>(config.exposure);
    for (int y = 0; y < light.rows; ++y) {
      const uchar* from = light.ptr<uchar>(y);
      const float* add = noise.data() + generator() % kNoiseTable;
      uchar* to = picture.ptr<uchar>(y);
      for (int x = 0; x < light.cols; ++x) {
        const float value = gain * static_cast<float>(from[x]) + add[x];
        to[x] = static_cast<uchar>(static_cast<int>(std::min(255.0F, std::max(0.0F, value))));
      }
    }
  }

  ArmView view;
  ArmBody body;
  SimulatedCameraConfig config;
  TagPainter tags;
  cv::Mat backdrop, sharp, blurred, picture;
  std::vector<float> noise;  // added by develop() before truncation
  std::mt19937 generator;
  std::vector<Occluder> occluders;
  int picture_number = 0;

  // State of the picture that is being rendered.
  std::vector<lie::SE3> tag_poses;  // X_CT
  std::vector<ArmNode> nodes;
  std::vector<Layer> layers;
};

SimulatedCamera::SimulatedCamera(const ArmView& view, const vision::TagFamily& family,
                                 const ArmBody& body, const SimulatedCameraConfig& config)
    : SimulatedCamera(view, printsOf(view.layout, family), body, config) {}
SimulatedCamera::SimulatedCamera(const ArmView& view, const std::vector<CardPrint>& prints,
                                 const ArmBody& body, const SimulatedCameraConfig& config)
    : work_(std::make_unique<Workspace>(view, prints, body, config)) {}
SimulatedCamera::~SimulatedCamera() = default;
SimulatedCamera::SimulatedCamera(SimulatedCamera&&) noexcept = default;
SimulatedCamera& SimulatedCamera::operator=(SimulatedCamera&&) noexcept = default;

const cv::Mat& SimulatedCamera::render(const model::Shape& shape) { return work_->render(shape); }

}  // namespace helix_arm::simulation
