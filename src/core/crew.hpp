// Workers that share the rows of a plane.
#pragma once

#include <type_traits>

namespace bolo {

// One part per worker where parts have a cost of their own, or several, so that a delayed worker delays nobody.
enum class Parts { kOneEach, kMany };

// Calls work(self, begin, end) for parts that together cover [0, rows), concurrently or in turn, and returns when all
// are done. A row's result must not depend on the split. Thread: pipeline.
class Crew {
 public:
  using Work = void (*)(void* self, int begin, int end) noexcept;
  virtual ~Crew() = default;
  virtual void run(int rows, Parts parts, Work work, void* self) noexcept = 0;
};

class Alone final : public Crew {
 public:
  void run(int rows, Parts /*parts*/, Work work, void* self) noexcept override { work(self, 0, rows); }
};

// work(begin, end) for parts of [0, rows).
template <typename Work>
void for_parts(Crew& crew, int rows, Work&& work, Parts parts = Parts::kOneEach) noexcept {
  crew.run(
      rows, parts,
      [](void* self, int begin, int end) noexcept {
        if (begin < end) (*static_cast<std::remove_reference_t<Work>*>(self))(begin, end);
      },
      &work);
}

template <typename Work>
void for_rows(Crew& crew, int rows, Work&& work) noexcept {
  auto each = [&](int begin, int end) {
    for (int row = begin; row < end; ++row) work(row);
  };
  for_parts(crew, rows, each, Parts::kMany);
}

}  // namespace bolo
