#include "helix_arm/simulation/card_print.hpp"

#include <numeric>

namespace helix_arm::simulation {
namespace {

constexpr double kEdge = 0.5;  // of white around a board [squares]

}  // namespace

double CardPrint::width() const { return std::accumulate(across.begin(), across.end(), 0.0); }

double CardPrint::height() const { return std::accumulate(down.begin(), down.end(), 0.0); }

CardPrint tagPrint(const vision::TagFamily& family, int id, double size) {
  CardPrint print{family.cells(id), {}, {}, size / family.borderCells()};
  print.across.assign(static_cast<std::size_t>(print.cells.cols), 1.0);
  print.down.assign(static_cast<std::size_t>(print.cells.rows), 1.0);
  return print;
}

CardPrint charucoPrint(const vision::CharucoBoard& board) {
  const int bits = vision::markerDictionary(board.dictionary).bits + 2;
  const int cells = bits + 2;  // of a square: those of a marker and what is around it
  const double cell = board.marker_size / board.square_size / bits;
  const double around = 0.5 * (1 - board.marker_size / board.square_size);
  const auto widths = [&](int squares) {
    std::vector<double> out{kEdge};
    for (int square = 0; square < squares; ++square) {
      out.push_back(around);
      out.insert(out.end(), static_cast<std::size_t>(bits), cell);
      out.push_back(around);
    }
    out.push_back(kEdge);
    return out;
  };
  CardPrint print{cv::Mat(board.rows * cells + 2, board.columns * cells + 2, CV_8UC1, 255.0),
                  widths(board.columns), widths(board.rows), board.square_size};
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const cv::Rect square(1 + column * cells, 1 + row * cells, cells, cells);
      if (board.isWhite(column, row)) {
        const cv::Rect inside(square.x + 1, square.y + 1, bits, bits);
        vision::markerCells(board.dictionary, board.markerIn(column, row))
            .copyTo(print.cells(inside));
      } else {
        print.cells(square) = 0.0;
      }
    }
  }
  return print;
}

}  // namespace helix_arm::simulation
