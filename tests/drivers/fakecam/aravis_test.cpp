// An independent client, Aravis in this process, reads the fake camera.
#include <arv.h>

#include "tests/drivers/fakecam/synthetic.hpp"

// Aravis and GLib are built without the thread sanitizer, which cannot see their locks.
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() {
  return "called_from_lib:libaravis-0.8.so\ncalled_from_lib:libglib-2.0.so\ncalled_from_lib:libgio-2.0.so\n"
         "race:libglib-2.0.so\nrace:libaravis-0.8.so\n";
}

namespace bolo::fakecam::aravis_test {

constexpr guint64 kHangGuardUs = 20'000'000;

template <typename T>
using Owned = std::unique_ptr<T, void (*)(gpointer)>;

template <typename T>
Owned<T> own(T* object) {
  return {object, g_object_unref};
}

struct Client {
  explicit Client(const std::string& address) : camera(own(arv_camera_new(address.c_str(), nullptr))) {
    if (camera) arv_camera_gv_set_stream_options(camera.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  }
  Owned<ArvStream> stream(unsigned buffers) {
    auto made = own(arv_camera_create_stream(camera.get(), nullptr, nullptr, nullptr));
    if (!made) return made;
    g_object_set(made.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size", 4 << 20,
                 nullptr);
    const std::size_t bytes = arv_camera_get_payload(camera.get(), nullptr);
    for (unsigned i = 0; i < buffers; ++i) arv_stream_push_buffer(made.get(), arv_buffer_new(bytes, nullptr));
    return made;
  }
  Owned<ArvCamera> camera;
};

TEST(FakeCameraAravis, GetsEveryFramePixelExact) {
  const auto address = test::fresh_address();
  constexpr Geometry kGeometry{640, 120};
  constexpr std::size_t kFrames = 60;
  const auto fake = test::serve(test::synthetic(kGeometry, kFrames), {.address = address});
  Client client(address);
  ASSERT_TRUE(client.camera);
  arv_camera_gv_set_packet_size(client.camera.get(), 9000, nullptr);
  arv_camera_set_float(client.camera.get(), "AcquisitionFrameRate", 50.0, nullptr);  // slow enough for a busy machine
  const auto stream = client.stream(kFrames);
  ASSERT_TRUE(stream);
  arv_camera_start_acquisition(client.camera.get(), nullptr);
  for (std::size_t f = 0; f < kFrames; ++f) {
    const auto buffer = own(arv_stream_timeout_pop_buffer(stream.get(), kHangGuardUs));
    ASSERT_TRUE(buffer) << "frame " << f;
    ASSERT_EQ(arv_buffer_get_status(buffer.get()), ARV_BUFFER_STATUS_SUCCESS) << "frame " << f;
    EXPECT_EQ(arv_buffer_get_frame_id(buffer.get()), 101 + f);
    EXPECT_EQ(arv_buffer_get_timestamp(buffer.get()), 2'000'000'000U + f * 20'000'000U);
    EXPECT_EQ(arv_buffer_get_image_pixel_format(buffer.get()), ARV_PIXEL_FORMAT_MONO_16);
    std::size_t bytes = 0;
    const auto* pixels = static_cast<const std::uint16_t*>(arv_buffer_get_data(buffer.get(), &bytes));
    ASSERT_EQ(bytes, kGeometry.pixels() * 2);
    for (std::size_t p = 0; p < kGeometry.pixels(); ++p) ASSERT_EQ(pixels[p], test::pixel_of(f, p));
  }
  arv_camera_stop_acquisition(client.camera.get(), nullptr);
}

TEST(FakeCameraAravis, EachFeatureOfTheDescriptionCanBeRead) {
  const auto address = test::fresh_address();
  const auto fake = test::serve(test::synthetic({64, 32}, 2), {.address = address});
  Client client(address);
  ASSERT_TRUE(client.camera);
  ArvDevice* device = arv_camera_get_device(client.camera.get());
  std::vector<std::string> open{"Root"};
  int values = 0;
  while (!open.empty()) {
    const std::string name = open.back();
    open.pop_back();
    ArvGcNode* node = arv_device_get_feature(device, name.c_str());
    ASSERT_NE(node, nullptr) << name << " is listed but not described";
    if (ARV_IS_GC_CATEGORY(node)) {
      for (const GSList* at = arv_gc_category_get_features(ARV_GC_CATEGORY(node)); at != nullptr; at = at->next) {
        open.emplace_back(static_cast<const char*>(at->data));
      }
      continue;
    }
    if (ARV_IS_GC_COMMAND(node)) continue;
    GError* error = nullptr;
    if (ARV_IS_GC_ENUMERATION(node)) {
      EXPECT_NE(arv_gc_enumeration_get_string_value(ARV_GC_ENUMERATION(node), &error), nullptr) << name;
    } else {
      EXPECT_NE(arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(node), &error), nullptr) << name;
    }
    EXPECT_EQ(error, nullptr) << name << ": " << error->message;
    g_clear_error(&error);
    ++values;
  }
  EXPECT_GT(values, 50);
}

}  // namespace bolo::fakecam::aravis_test
