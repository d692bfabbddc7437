// Control of a camera that a program held when it died.
#include <gtest/gtest.h>

#include <optional>

#include "drivers/genicam/network.hpp"
#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"

namespace bolo::genicam::dead_program_test {
namespace {

using fakecam::FakeCamera;
using fakecam::FakeCameraOptions;
using fakecam::test::RawClient;
namespace reg = fakecam::reg;

class DeadProgram : public testing::Test {
 protected:
  void SetUp() override {
    FakeCameraOptions options;
    options.address = fakecam::test::fresh_address();
    auto camera = FakeCamera::start(options, fakecam::test::provider_of(fakecam::test::synthetic({16, 8}, 4)));
    ASSERT_TRUE(camera) << camera.error().message;
    camera_ = std::move(*camera);
    program_.emplace(options.address);
    address_ = options.address;
    ASSERT_EQ(program_->take_control(), fakecam::gvcp::Status::kSuccess);
  }
  std::uint32_t privilege() const { return RawClient(address_).read(reg::kPrivilege); }

  std::string address_;
  std::unique_ptr<FakeCamera> camera_;
  std::optional<RawClient> program_;
};

TEST_F(DeadProgram, LetsGoOfTheCamera) {
  program_.reset();  // its socket closes, the camera hears nothing of it
  ASSERT_NE(privilege(), 0U);
  EXPECT_TRUE(free_from_dead_program(address_, "127.0.0.1"));
  EXPECT_EQ(privilege(), 0U);
}

TEST_F(DeadProgram, IsNotOneThatLives) {
  EXPECT_FALSE(free_from_dead_program(address_, "127.0.0.1"));
  EXPECT_NE(privilege(), 0U);
}

TEST_F(DeadProgram, IsNotOneOnAnotherComputer) {
  program_.reset();
  EXPECT_FALSE(free_from_dead_program(address_, "127.0.0.2"));
  EXPECT_NE(privilege(), 0U);
}

TEST_F(DeadProgram, HasNothingToLetGoOfWhenNobodyIsInControl) {
  ASSERT_EQ(program_->write(reg::kPrivilege, 0), fakecam::gvcp::Status::kSuccess);
  EXPECT_FALSE(free_from_dead_program(address_, "127.0.0.1"));
}

}  // namespace
}  // namespace bolo::genicam::dead_program_test
