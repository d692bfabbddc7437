// Workers that share the rows of a plane.
#pragma once

#include <type_traits>

namespace bolo {

// Calls work(self, begin, end) for parts of [0, rows) that together are all of it, at the same time or one after the
// other, and returns when all are done. A row's result must not depend on its part. Thread: pipeline.
class Crew {
 public:
  virtual ~Crew() = default;
  virtual void run(int rows, void (*work)(void* self, int begin, int end) noexcept, void* self) noexcept = 0;
};

// The calling thread alone.
class Alone final : public Crew {
 public:
  void run(int rows, void (*work)(void*, int, int) noexcept, void* self) noexcept override { work(self, 0, rows); }
};

// work(begin, end) for parts of [0, rows).
template <typename Work>
void for_parts(Crew& crew, int rows, Work&& work) noexcept {
  crew.run(
      rows,
      [](void* self, int begin, int end) noexcept {
        if (begin < end) (*static_cast<std::remove_reference_t<Work>*>(self))(begin, end);
      },
      &work);
}

// work(row) for each of [0, rows).
template <typename Work>
void for_rows(Crew& crew, int rows, Work&& work) noexcept {
  for_parts(crew, rows, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) work(row);
  });
}

}  // namespace bolo
