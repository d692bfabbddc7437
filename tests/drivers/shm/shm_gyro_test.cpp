// A gyro's samples from shared memory whose writers die, jump in time or write garbage.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "drivers/shm/shm_gyro.hpp"
#include "src/core/clock.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/pipeline/count_allocations.hpp"

namespace bolo::shm::shm_gyro_test {

constexpr std::uint32_t kCapacity = 64;
constexpr std::int64_t kStep = 1'000'000;

class Writer {
 public:
  explicit Writer(std::string name) : path_("/bolo-gyro." + name), name_(std::move(name)) { make(); }
  ~Writer() { shm_unlink(path_.c_str()); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  const std::string& name() const { return name_; }
  void make() {
    shm_unlink(path_.c_str());
    object_ = UniqueFd(shm_open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL, 0600));
    ASSERT_TRUE(object_);
    resize(sizeof header + kCapacity * sizeof(bolo_gyro_sample));
    header = {BOLO_GYRO_MAGIC, BOLO_GYRO_VERSION, kCapacity, 0, {}};
    put_header();
  }
  void resize(std::size_t bytes) const { ASSERT_EQ(ftruncate(object_.get(), static_cast<off_t>(bytes)), 0); }
  void put(const void* data, std::size_t bytes, std::size_t at) const {
    ASSERT_EQ(pwrite(object_.get(), data, bytes, static_cast<off_t>(at)), static_cast<ssize_t>(bytes));
  }
  void put_header() const { put(&header, sizeof header, 0); }
  void write(std::int64_t time_ns, double x, double y = 0.0, double z = 0.0) {
    const bolo_gyro_sample sample{time_ns, {x, y, z}};
    put(&sample, sizeof sample, sizeof header + header.written % kCapacity * sizeof sample);
    ++header.written;
    put_header();
  }
  int fd() const { return object_.get(); }

  bolo_gyro_header header{};

 private:
  std::string path_;
  std::string name_;
  UniqueFd object_;
};

std::unique_ptr<Gyro> gyro_of(const std::string& name) {
  auto made = ShmGyro::create(name);
  EXPECT_TRUE(made);
  (*made)->samples();  // opens the object
  return std::move(*made);
}

void wait_for_reopening() { std::this_thread::sleep_for(std::chrono::milliseconds(550)); }

TEST(ShmGyro, SamplesComeOnceAndInOrder) {
  Writer writer(unique_name("order"));
  const auto gyro = gyro_of(writer.name());
  for (int i = 1; i <= 200; ++i) {
    writer.write(i * kStep, 0.01 * i, -1.0, 2.0);
    if (i % 20 == 0) {
      ASSERT_EQ(gyro->samples().size(), static_cast<std::size_t>(i));
    }
  }
  for (int i = 0; i < 200; ++i) {
    const GyroSample& sample = gyro->samples()[static_cast<std::size_t>(i)];
    EXPECT_EQ(sample.time_ns, (i + 1) * kStep);
    EXPECT_EQ(sample.rate, (std::array<double, 3>{0.01 * (i + 1), -1.0, 2.0}));
  }
}

// When the ring wrapped around, only the newer half is read: the writer may be in the other half.
TEST(ShmGyro, WhatWasMissedIsPassedOver) {
  Writer writer(unique_name("missed"));
  const auto gyro = gyro_of(writer.name());
  for (int i = 1; i <= 1000; ++i) writer.write(i * kStep, 1.0);
  const auto samples = gyro->samples();
  ASSERT_EQ(samples.size(), kCapacity / 2);
  EXPECT_EQ(samples.back().time_ns, 1000 * kStep);
}

TEST(ShmGyro, AWriterMayComeLateDieAndComeAgain) {
  const std::string name = unique_name("late");
  const auto gyro = gyro_of(name);
  EXPECT_TRUE(gyro->samples().empty());
  Writer writer(name);
  writer.write(kStep, 1.0);
  wait_for_reopening();
  gyro->samples();
  EXPECT_EQ(gyro->samples().size(), 1U);
  writer.make();
  writer.write(5 * kStep, 2.0);
  wait_for_reopening();
  gyro->samples();
  ASSERT_EQ(gyro->samples().size(), 1U);
  EXPECT_EQ(gyro->samples()[0].time_ns, 5 * kStep);
}

TEST(ShmGyro, WhatIsNoRateIsPassedOverAndTimeThatGoesBackForgetsWhatWas) {
  Writer writer(unique_name("rubbish"));
  const auto gyro = gyro_of(writer.name());
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  writer.write(1 * kStep, 1.0);
  writer.write(2 * kStep, kNan);
  writer.write(3 * kStep, 0.0, 1.0, std::numeric_limits<double>::infinity());
  writer.write(4 * kStep, 0.0, -1e300);
  writer.write(-5 * kStep, 1.0);
  writer.write(std::numeric_limits<std::int64_t>::max(), 1.0);
  writer.write(std::numeric_limits<std::int64_t>::min(), 1.0);
  EXPECT_EQ(gyro->samples().size(), 1U);
  writer.write(1 * kStep, 7.0);  // the same time again
  EXPECT_EQ(gyro->samples().size(), 1U);
  writer.write(1000 * kStep, 1.0);
  EXPECT_EQ(gyro->samples().size(), 2U);
  writer.write(2 * kStep, 1.0);
  ASSERT_EQ(gyro->samples().size(), 1U);
  EXPECT_EQ(gyro->samples()[0].time_ns, 2 * kStep);
}

TEST(ShmGyro, AnObjectThatIsNoneOrCutShortGivesNothing) {
  Writer writer(unique_name("fields"));
  const auto gyro = gyro_of(writer.name());
  const bolo_gyro_header good = writer.header;
  const auto nothing_with = [&](auto change) {
    writer.header = good;
    writer.header.written = 40;
    change(writer.header);
    writer.put_header();
    return gyro->samples().empty();
  };
  EXPECT_TRUE(nothing_with([](auto& h) { h.magic += 1; }));
  EXPECT_TRUE(nothing_with([](auto& h) { h.version += 1; }));
  for (const std::uint32_t capacity : {0U, 1U, kCapacity - 1, BOLO_GYRO_MOST_CAPACITY + 1, ~0U}) {
    EXPECT_TRUE(nothing_with([=](auto& h) { h.capacity = capacity; }));
  }
  for (const std::size_t bytes : {std::size_t{0}, std::size_t{20}, sizeof good, sizeof good + 100}) {
    writer.resize(bytes);
    gyro->samples();  // zeros at most
    EXPECT_LE(gyro->samples().size(), 1U);
  }
  writer.make();
}

TEST(ShmGyro, APipeOrAnothersFileUnderTheNameIsLeftAlone) {
  const std::string name = unique_name("pipe");
  const std::string file = "/dev/shm/bolo-gyro." + name;
  ASSERT_EQ(mkfifo(file.c_str(), 0600), 0);
  const auto start = monotonic_ns();
  EXPECT_TRUE(gyro_of(name)->samples().empty());
  EXPECT_LT(monotonic_ns() - start, 1'000'000'000);
  unlink(file.c_str());
  if (geteuid() != 0) GTEST_SKIP() << "needs root to give a file away";
  Writer writer(name);
  writer.write(kStep, 1.0);
  ASSERT_EQ(fchown(writer.fd(), 54321, 54321), 0);
  const auto gyro = gyro_of(name);
  EXPECT_TRUE(gyro->samples().empty());
}

// For any bytes, samples rise in time and have valid rates, and nothing is allocated.
TEST(ShmGyro, RandomBytesDoNoHarm) {
  Writer writer(unique_name("random"));
  const auto gyro = gyro_of(writer.name());
  std::mt19937_64 random(1);
  test::reset_allocation_count();
  for (int round = 0; round < 2000; ++round) {
    std::array<std::uint64_t, 4 * kCapacity> words;
    for (auto& w : words) w = random() >> (random() % 64);
    writer.put(words.data(), sizeof words, sizeof(bolo_gyro_header));
    writer.header.written = random() % 3 == 0 ? random() : writer.header.written + random() % 200;
    writer.put_header();
    test::arm_allocation_count();
    const auto samples = gyro->samples();
    test::disarm_allocation_count();
    for (std::size_t i = 0; i < samples.size(); ++i) {
      ASSERT_TRUE(is_turn(samples[i].rate));
      ASSERT_TRUE(i == 0 || samples[i].time_ns > samples[i - 1].time_ns);
    }
  }
  EXPECT_EQ(test::allocation_count(), 0U);
}

}  // namespace bolo::shm::shm_gyro_test
