#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <memory>
#include <optional>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Any PartModel, chosen at run time: constellations of mixed parts are a std::vector<AnyPart>. It is itself
/// a PartModel, and dense and resizable if the model in it is. A copy copies the model. After a move from it,
/// it may only be assigned to or destroyed.
class AnyPart {
 public:
  // In this order: PartModel<AnyPart> asks whether AnyPart is copyable, and so this very constraint.
  /// Holds any part model except an AnyPart.
  template <class P>
  requires(!std::same_as<P, AnyPart> && PartModel<P>) AnyPart(P part)
      : self_(std::make_unique<Model<P>>(std::move(part))) {}

  /// The copy learns independently.
  AnyPart(const AnyPart& other) : self_(other.self_->clone()) {}
  AnyPart(AnyPart&&) noexcept = default;
  AnyPart& operator=(const AnyPart& other) {
    self_ = other.self_->clone();
    return *this;
  }
  AnyPart& operator=(AnyPart&&) noexcept = default;
  ~AnyPart() = default;

  void init(const Frame& frame, const Point2& centre, const Size2& size) { self_->init(frame, centre, size); }
  Evidence localize(const Frame& frame, const Point2& around) { return self_->localize(frame, around); }
  double similarity_at(const Point2& position) const { return self_->similarity_at(position); }
  void adapt(const Frame& frame, const Point2& at) { self_->adapt(frame, at); }

  /// The response map of the last `localize`, or nullptr if the model has none (see DenseModel).
  const ResponseMap* response() const { return self_->response(); }
  /// The target has another size in the image [px] from now on. A model that is not a ResizableModel keeps
  /// the size that it has.
  void resize(const Size2& size) { self_->resize(size); }
  /// The target's size [px] by the last `localize`; none if the model does not measure it (see SizingModel).
  std::optional<Size2> found_size() const { return self_->found_size(); }
  /// Whether the model in it is Stateful; if not, `visit_state` throws std::invalid_argument.
  bool stateful() const { return self_->stateful(); }
  void visit_state(StateArchive& archive) { self_->visit_state(archive); }

  /// The model in it if that is a P, otherwise nullptr.
  template <class P>
  const P* target() const {
    const auto* const model = dynamic_cast<const Model<P>*>(self_.get());
    return model != nullptr ? &model->part : nullptr;
  }

 private:
  struct Concept {
    virtual ~Concept() = default;
    virtual std::unique_ptr<Concept> clone() const = 0;
    virtual void init(const Frame&, const Point2&, const Size2&) = 0;
    virtual Evidence localize(const Frame&, const Point2&) = 0;
    virtual double similarity_at(const Point2&) const = 0;
    virtual void adapt(const Frame&, const Point2&) = 0;
    virtual const ResponseMap* response() const = 0;
    virtual void resize(const Size2&) = 0;
    virtual std::optional<Size2> found_size() const = 0;
    virtual bool stateful() const = 0;
    virtual void visit_state(StateArchive&) = 0;
  };
  template <class P>
  struct Model final : Concept {
    explicit Model(P p) : part(std::move(p)) {}
    std::unique_ptr<Concept> clone() const override { return std::make_unique<Model>(part); }
    void init(const Frame& frame, const Point2& centre, const Size2& size) override {
      part.init(frame, centre, size);
    }
    Evidence localize(const Frame& frame, const Point2& around) override {
      return part.localize(frame, around);
    }
    double similarity_at(const Point2& position) const override { return part.similarity_at(position); }
    void adapt(const Frame& frame, const Point2& at) override { part.adapt(frame, at); }
    const ResponseMap* response() const override {
      if constexpr (DenseModel<P>)
        return pointer_to(part.response());
      else
        return nullptr;
    }
    void resize(const Size2& size) override {
      if constexpr (ResizableModel<P>) part.resize(size);
    }
    std::optional<Size2> found_size() const override {
      if constexpr (SizingModel<P>)
        return part.found_size();
      else
        return {};
    }
    bool stateful() const override {
      if constexpr (requires { part.stateful(); })
        return part.stateful();  // a wrapper of any part
      else
        return Stateful<P>;
    }
    void visit_state(StateArchive& archive) override {
      if constexpr (Stateful<P>)
        part.visit_state(archive);
      else
        throw_not_stateful("part model");
    }
    static const ResponseMap* pointer_to(const ResponseMap& response) { return &response; }
    static const ResponseMap* pointer_to(const ResponseMap* response) { return response; }
    P part;
  };
  std::unique_ptr<Concept> self_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
