// Paths, and the trajectory files that they follow.
#include "src/sim/path.hpp"
#include "tests/sim/support.hpp"

namespace bolo::sim::path_test {

TEST(SteadyPan, MovesWhatIsSeenAlongX) {
  const Path pan = steady_pan(300.0);
  EXPECT_DOUBLE_EQ(pan.at(0.5).x_px, -150.0);  // the view moves against it
  EXPECT_DOUBLE_EQ(pan.at(-0.1).x_px, 30.0);
  EXPECT_DOUBLE_EQ(pan.at(7.0).x_px, -2100.0);
  EXPECT_EQ(pan.at(3.0).y_px, 0.0);
}

TEST(Path, GoesStraightBetweenAndBeyondItsPoints) {
  const Path path({{0, 0, 10}, {1, 4, 10}, {3, 4, 30}});
  EXPECT_DOUBLE_EQ(path.at(0.25).x_px, 1.0);
  EXPECT_DOUBLE_EQ(path.at(2.0).y_px, 20.0);
  EXPECT_DOUBLE_EQ(path.at(-1.0).x_px, -4.0);
  EXPECT_DOUBLE_EQ(path.at(4.0).y_px, 40.0);
}

TEST(Path, BoundsHoldTheBendsBetween) {
  const Path path({{0, 0, 0}, {1, 9, -2}, {2, 1, 5}});
  const auto bounds = path.bounds(0.0, 2.0);
  EXPECT_EQ(bounds.low.x_px, 0.0);
  EXPECT_EQ(bounds.high.x_px, 9.0);
  EXPECT_EQ(bounds.low.y_px, -2.0);
  EXPECT_EQ(bounds.high.y_px, 5.0);
}

TEST(Path, AStillCameraNeedsOneStep) {
  std::vector<double> times;
  steady_pan(0.0).crossings(0.0, 0.005, times);
  EXPECT_EQ(times, std::vector<double>{0.005});
}

using testing::Scratch;

std::string refusal(const std::string& content) {
  const Scratch scratch;
  const auto points = read_trajectory(scratch.text("t.csv", content));
  if (points) return "accepted";
  EXPECT_EQ(points.error().exit_code(), 2);
  const std::string& message = points.error().message;
  return message.substr(message.find("t.csv"));
}

TEST(ReadTrajectory, TakesCommentsBlankLinesAndCarriageReturns) {
  const Scratch scratch;
  const auto points =
      must(read_trajectory(scratch.text("t.csv", "# hand\nt_s,x_px,y_px\r\n0, 1.5,-2\r\n\n# more\n0.1,2e0,3\n")));
  ASSERT_EQ(points->size(), 2U);
  EXPECT_EQ((*points)[0].y_px, -2.0);
  EXPECT_EQ((*points)[1].t_s, 0.1);
  EXPECT_EQ((*points)[1].x_px, 2.0);
}

TEST(ReadTrajectory, RefusesBadFilesByLine) {
  const std::string head = "t_s,x_px,y_px\n";
  const std::string numbers = "expected three finite numbers 't_s,x_px,y_px'";
  EXPECT_EQ(refusal("x,y,t\n0,0,0\n"), "t.csv:1: the first line must be 't_s,x_px,y_px'");
  EXPECT_EQ(refusal(head + "0,0,0\n1,2\n"), "t.csv:3: " + numbers);
  EXPECT_EQ(refusal(head + "0,0,0\n1,2,3,4\n"), "t.csv:3: " + numbers);
  EXPECT_EQ(refusal(head + "0,0,0\n\n1,2,x\n"), "t.csv:4: " + numbers);
  EXPECT_EQ(refusal(head + "0,nan,0\n"), "t.csv:2: " + numbers);
  EXPECT_EQ(refusal(head + "0,1e999,0\n"), "t.csv:2: " + numbers);
  EXPECT_EQ(refusal(head + "0,0,0\n1,0,0\n1,0,0\n"), "t.csv:4: t_s must rise from line to line");
  EXPECT_EQ(refusal(head + "0,0,0\n"), "t.csv: a trajectory needs at least two points");
  EXPECT_EQ(refusal(""), "t.csv: a trajectory needs at least two points");
  EXPECT_FALSE(read_trajectory("/nonexistent/t.csv"));
}

TEST(FollowTrajectory, PassesThroughThePointsAndStartsAtZero) {
  const std::vector<PathPoint> points{{0, 5, 1}, {1, 8, 3}, {2, 4, 2}, {3, 4, -1}};
  const auto path = must(follow_trajectory(points, {2.0, 1.0, -1.0, 2.0, 0.125}));
  EXPECT_NEAR(path->at(0.0).x_px, 0.0, 1e-12);
  EXPECT_NEAR(path->at(-1.0).x_px, 2.0 * (5 - 8), 1e-12);
  EXPECT_NEAR(path->at(1.0).y_px, 2.0 * (2 - 3), 1e-12);
  EXPECT_NEAR(path->at(2.0).y_px, 2.0 * (-1 - 3), 1e-12);
}

// For the values 0, 1, 0 at 0, 1, 2 the natural spline is x = 1.5 t - 0.5 t^3 up to t = 1.
TEST(FollowTrajectory, IsTheNaturalCubicSpline) {
  const std::vector<PathPoint> points{{0, 0, 0}, {1, 1, 0}, {2, 0, 0}};
  const auto path = must(follow_trajectory(points, {1.0, 0.0, -0.5, 2.0, 0.25}));
  EXPECT_NEAR(path->at(0.5).x_px, 1.5 * 0.5 - 0.5 * 0.125, 1e-12);
  EXPECT_NEAR(path->at(1.5).x_px, 1.5 * 0.5 - 0.5 * 0.125, 1e-12);
  EXPECT_NEAR(path->at(-0.5).x_px, -0.75, 1e-12);  // straight on before the first point
}

TEST(FollowTrajectory, RefusesACaptureThatOutlivesIt) {
  const std::vector<PathPoint> points{{0, 0, 0}, {1, 1, 0}};
  EXPECT_TRUE(follow_trajectory(points, {1.0, 0.5, -0.1, 0.5, 0.01}));
  EXPECT_FALSE(follow_trajectory(points, {1.0, 0.5, -0.1, 0.6, 0.01}));
  EXPECT_FALSE(follow_trajectory(points, {1.0, -0.1, -0.1, 0.5, 0.01}));
}

}  // namespace bolo::sim::path_test
