#include <asterism/solver/problem/validate.hpp>

#include "petsc_internal.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail::distributed {

template <int kDim>
Message share_problem(const SystemShare<kDim>& share, std::int64_t first, std::int64_t nodes) {
  const Eigen::Index n = share.anchors.cols();
  const auto links = static_cast<Eigen::Index>(share.links.size());
  if (share.anchor_stiffness.size() != n) return "anchor stiffness must have one entry for each node";
  if (share.start.cols() != n) return "start must have one column for each node";
  if (share.rest_length.size() != links) return "rest length must have one entry for each link";
  if (share.link_stiffness.size() != links) return "link stiffness must have one entry for each link";
  if (nodes == 0) return "system has no nodes";
  if (nodes > PETSC_MAX_INT / kDim)
    return numbered("a system of", nodes,
                    "nodes needs a PETSc of 64-bit indices (Debian package petsc64-dev)");

  constexpr auto kNotFinite = "is not finite";
  constexpr auto kNotPositive = "is negative or not finite";
  if (const int i = first_column_not_finite(share.anchors); i >= 0)
    return numbered("anchor", first + i, kNotFinite);
  if (const int i = first_bad_entry(share.anchor_stiffness); i >= 0)
    return numbered("anchor stiffness", first + i, kNotPositive);
  if (const int i = first_column_not_finite(share.start); i >= 0)
    return numbered("x of node", first + i, kNotFinite);
  const auto is_node = [nodes](std::int64_t number) { return 0 <= number && number < nodes; };
  for (std::size_t l = 0; l < share.links.size(); ++l) {
    const auto [i, j] = share.links[l];
    const auto refuse = [&, i = i, j = j](const char* problem) {
      return Message("link of nodes ")
          .append(std::to_string(i))
          .append(" and ")
          .append(std::to_string(j))
          .append(problem);
    };
    if (!is_node(i) || !is_node(j)) return refuse(" has an end that is out of range");
    if (i == j) return refuse(" joins a node to itself");
    const auto entry = static_cast<Eigen::Index>(l);
    if (!is_finite(share.rest_length[entry]) || share.rest_length[entry] < 0)
      return refuse(" has a rest length that is negative or not finite");
    if (!is_finite(share.link_stiffness[entry]) || share.link_stiffness[entry] < 0)
      return refuse(" has a stiffness that is negative or not finite");
  }
  for (const std::int64_t number : share.fixed) {
    if (!is_node(number)) return numbered("fixed node", number, "is out of range");
  }
  return {};
}

struct LinkRecord {
  std::int64_t id, i, j;
  double rest_length, stiffness;
};

template <int kDim>
struct NodeRecord {
  std::int64_t number;
  double anchor[kDim], start[kDim];
  double stiffness;
  bool is_fixed;
};

template <typename Record>
void sort_by(std::vector<Record>& records, std::int64_t Record::*key) {
  std::sort(records.begin(), records.end(),
            [key](const Record& a, const Record& b) { return a.*key < b.*key; });
}

/// Before the partitioning: node numbers in equal ranges, one a process, whose process knows the node.
class Directory {
 public:
  Directory(const Communicator& comm, std::int64_t nodes) {
    check(PetscLayoutCreateFromSizes(comm, PETSC_DECIDE, static_cast<PetscInt>(nodes), 1, &layout_));
    check(PetscLayoutGetRange(layout_, &begin_, &end_));
  }
  int process_of(std::int64_t node) const {
    PetscMPIInt process = 0;
    check(PetscLayoutFindOwner(layout_, static_cast<PetscInt>(node), &process));
    return process;
  }
  std::int64_t begin() const { return begin_; }
  std::size_t size() const { return static_cast<std::size_t>(end_ - begin_); }
  bool has(std::int64_t node) const { return begin_ <= node && node < end_; }
  std::size_t place(std::int64_t node) const { return static_cast<std::size_t>(node - begin_); }

 private:
  OwnedLayout layout_;
  PetscInt begin_ = 0;
  PetscInt end_ = 0;
};

namespace {

/// Sends link l to processes to(l), a pair whose entries may be equal or -1. What a process gets twice it
/// keeps once; by id.
template <typename To>
std::vector<LinkRecord> send_links(const Communicator& comm, const std::vector<LinkRecord>& links, To&& to) {
  std::vector<LinkRecord> records;
  std::vector<int> processes;
  for (const LinkRecord& link : links) {
    const auto [one, other] = to(link);
    for (const int process : {one, other == one ? -1 : other}) {
      if (process < 0) continue;
      records.push_back(link);
      processes.push_back(process);
    }
  }
  auto received = comm.exchange<LinkRecord>(records, processes);
  sort_by(received, &LinkRecord::id);
  const auto same = [](const LinkRecord& a, const LinkRecord& b) { return a.id == b.id; };
  received.erase(std::unique(received.begin(), received.end(), same), received.end());
  return received;
}

/// The process that each of the directory's nodes goes to, by PETSc's partitioner. Without links, or with few
/// nodes, which partitioners do not take, nodes stay.
std::vector<PetscInt> choose_processes(const Communicator& comm, const Directory& directory,
                                       std::int64_t nodes, std::int64_t link_count,
                                       const std::vector<LinkRecord>& links) {
  std::vector<PetscInt> processes(directory.size(), comm.rank());
  constexpr int kFewNodes = 8;  // a process
  if (comm.size() == 1 || link_count == 0 || nodes < kFewNodes * comm.size()) return processes;

  std::vector<std::pair<std::size_t, PetscInt>> neighbours;
  for (const LinkRecord& link : links) {
    if (directory.has(link.i)) neighbours.emplace_back(directory.place(link.i), link.j);
    if (directory.has(link.j)) neighbours.emplace_back(directory.place(link.j), link.i);
  }
  std::sort(neighbours.begin(), neighbours.end());
  neighbours.erase(std::unique(neighbours.begin(), neighbours.end()), neighbours.end());
  PetscInt* rows = nullptr;  // the matrix frees them
  PetscInt* columns = nullptr;
  check(PetscCalloc1(directory.size() + 1, &rows));
  check(PetscMalloc1(neighbours.size() + 1, &columns));
  for (std::size_t e = 0; e < neighbours.size(); ++e) {
    ++rows[neighbours[e].first + 1];
    columns[e] = neighbours[e].second;
  }
  std::partial_sum(rows, rows + directory.size() + 1, rows);

  OwnedMat adjacency;
  OwnedPartitioning partitioning;
  OwnedIs chosen;
  check(MatCreateMPIAdj(comm, static_cast<PetscInt>(directory.size()), static_cast<PetscInt>(nodes), rows,
                        columns, nullptr, &adjacency));
  check(MatPartitioningCreate(comm, &partitioning));
  check(
      PetscObjectSetOptionsPrefix(reinterpret_cast<PetscObject>(MatPartitioning(partitioning)), "asterism_"));
  check(MatPartitioningSetAdjacency(partitioning, adjacency));
  check(MatPartitioningSetFromOptions(partitioning));
  check(MatPartitioningApply(partitioning, &chosen));
  const PetscInt* values = nullptr;
  check(ISGetIndices(chosen, &values));
  std::copy_n(values, processes.size(), processes.begin());
  check(ISRestoreIndices(chosen, &values));
  return processes;
}

/// The share's nodes and links as the directory has them: nodes by number, links at each end, by id.
template <int kDim>
std::vector<NodeRecord<kDim>> nodes_of(const Communicator& comm, const Directory& directory,
                                       const SystemShare<kDim>& share, std::int64_t first) {
  std::vector<NodeRecord<kDim>> nodes;
  std::vector<int> to;
  for (Eigen::Index i = 0; i < share.anchors.cols(); ++i) {
    NodeRecord<kDim> node{first + i, {}, {}, share.anchor_stiffness[i], false};
    std::copy_n(share.anchors.col(i).data(), kDim, node.anchor);
    std::copy_n(share.start.col(i).data(), kDim, node.start);
    nodes.push_back(node);
    to.push_back(directory.process_of(node.number));
  }
  nodes = comm.exchange<NodeRecord<kDim>>(nodes, to);
  sort_by(nodes, &NodeRecord<kDim>::number);

  to.clear();
  for (const std::int64_t number : share.fixed) to.push_back(directory.process_of(number));
  for (const std::int64_t number : comm.exchange<std::int64_t>(share.fixed, to))
    nodes[directory.place(number)].is_fixed = true;
  return nodes;
}

template <int kDim>
std::vector<LinkRecord> links_of(const Communicator& comm, const Directory& directory,
                                 const SystemShare<kDim>& share) {
  const std::int64_t first = comm.before(std::ssize(share.links));
  std::vector<LinkRecord> links;
  for (std::size_t l = 0; l < share.links.size(); ++l) {
    const auto entry = static_cast<Eigen::Index>(l);
    links.push_back({first + entry, share.links[l].i, share.links[l].j, share.rest_length[entry],
                     share.link_stiffness[entry]});
  }
  return send_links(comm, links, [&](const LinkRecord& link) {
    return std::pair(directory.process_of(link.i), directory.process_of(link.j));
  });
}

/// Fills in the anchors of the ghosts and whether these are fixed, from the processes that own them.
template <int kDim>
void fetch_ghosts(const Communicator& comm, LocalSystem<kDim>& local) {
  constexpr int kValues = kDim + 2;  // anchor, its stiffness, whether the node is fixed
  const auto ghosts = static_cast<PetscInt>(local.numbers.size()) - local.own;
  OwnedVec owned, fetched;
  check(VecCreate(comm, &owned));
  check(VecSetSizes(owned, kValues * local.own, PETSC_DETERMINE));
  check(VecSetBlockSize(owned, kValues));
  check(VecSetType(owned, VECSTANDARD));
  check(VecCreateSeq(PETSC_COMM_SELF, kValues * ghosts, &fetched));
  auto& system = local.system;
  double* values = nullptr;
  check(VecGetArrayWrite(owned, &values));
  for (int i = 0; i < local.own; ++i, values += kValues) {
    std::copy_n(system.anchors.col(i).data(), kDim, values);
    values[kDim] = system.anchor_stiffness[i];
    values[kDim + 1] = system.is_fixed(i) ? 1 : 0;
  }
  values -= kValues * local.own;
  check(VecRestoreArrayWrite(owned, &values));

  OwnedIs from;
  OwnedScatter scatter;
  check(ISCreateBlock(PETSC_COMM_SELF, kValues, ghosts, local.rows.data() + local.own, PETSC_COPY_VALUES,
                      &from));
  check(VecScatterCreate(owned, from, fetched, nullptr, &scatter));
  check(VecScatterBegin(scatter, owned, fetched, INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter, owned, fetched, INSERT_VALUES, SCATTER_FORWARD));
  const double* found = nullptr;
  check(VecGetArrayRead(fetched, &found));
  for (int g = 0; g < ghosts; ++g) {
    const double* const ghost = found + kValues * g;
    std::copy_n(ghost, kDim, system.anchors.col(local.own + g).data());
    system.anchor_stiffness[local.own + g] = ghost[kDim];
    if (ghost[kDim + 1] > 0) system.fix(local.own + g);
  }
  check(VecRestoreArrayRead(fetched, &found));
}

}  // namespace

template <int kDim>
LocalSystem<kDim> partition(const Communicator& comm, const SystemShare<kDim>& share) {
  LocalSystem<kDim> local;
  const std::int64_t count = share.anchors.cols();
  local.nodes = comm.sum(count);
  local.links = comm.sum(std::int64_t{std::ssize(share.links)});

  const Directory directory(comm, local.nodes);
  auto nodes = nodes_of(comm, directory, share, comm.before(count));
  auto links = links_of(comm, directory, share);
  const std::vector<PetscInt> chosen = choose_processes(comm, directory, local.nodes, local.links, links);

  // PETSc's numbers: by process, and there in the order of the nodes' own numbers.
  const auto known = static_cast<PetscInt>(nodes.size());
  std::vector<PetscInt> application(nodes.size());
  std::iota(application.begin(), application.end(), static_cast<PetscInt>(directory.begin()));
  OwnedIs processes, numbering, applications;
  OwnedAo order;
  check(ISCreateGeneral(comm, known, chosen.data(), PETSC_COPY_VALUES, &processes));
  check(ISPartitioningToNumbering(processes, &numbering));
  check(ISCreateGeneral(comm, known, application.data(), PETSC_COPY_VALUES, &applications));
  check(AOCreateMemoryScalableIS(applications, numbering, &order));

  const std::vector<int> to(chosen.begin(), chosen.end());
  nodes = comm.exchange<NodeRecord<kDim>>(nodes, to);
  sort_by(nodes, &NodeRecord<kDim>::number);
  links = send_links(comm, links, [&](const LinkRecord& link) {
    const auto process_of = [&](std::int64_t node) {
      return directory.has(node) ? to[directory.place(node)] : -1;
    };
    return std::pair(process_of(link.i), process_of(link.j));
  });

  // Own nodes, then ghosts.
  local.own = static_cast<int>(nodes.size());
  auto& numbers = local.numbers;
  for (const auto& node : nodes) numbers.push_back(node.number);
  const auto place = [&numbers](auto begin, auto end, std::int64_t number) {
    const auto found = std::lower_bound(begin, end, number);
    return found != end && *found == number ? static_cast<int>(found - numbers.begin()) : -1;
  };
  std::vector<std::int64_t> ghosts;
  for (const LinkRecord& link : links) {
    for (const std::int64_t end : {link.i, link.j}) {
      if (place(numbers.begin(), numbers.end(), end) < 0) ghosts.push_back(end);
    }
  }
  std::sort(ghosts.begin(), ghosts.end());
  ghosts.erase(std::unique(ghosts.begin(), ghosts.end()), ghosts.end());
  numbers.insert(numbers.end(), ghosts.begin(), ghosts.end());
  local.rows.assign(numbers.begin(), numbers.end());
  check(AOApplicationToPetsc(order, static_cast<PetscInt>(local.rows.size()), local.rows.data()));

  std::vector<Link> local_links;
  std::int64_t cut = 0;
  for (const LinkRecord& link : links) {
    const auto local_of = [&](std::int64_t number) {
      const int own = place(numbers.begin(), numbers.begin() + local.own, number);
      return own >= 0 ? own : place(numbers.begin() + local.own, numbers.end(), number);
    };
    local_links.push_back({local_of(link.i), local_of(link.j)});
    cut += local_links.back().j >= local.own ? 1 : 0;  // counted where its first end is
  }
  local.cut_links = comm.sum(cut);

  local.system =
      SpringSystem<double, kDim>(Topology<>::from_links(static_cast<int>(numbers.size()), local_links));
  local.start.resize(kDim, local.own);
  for (int i = 0; i < local.own; ++i) {
    const auto& node = nodes[static_cast<std::size_t>(i)];
    std::copy_n(node.anchor, kDim, local.system.anchors.col(i).data());
    std::copy_n(node.start, kDim, local.start.col(i).data());
    local.system.anchor_stiffness[i] = node.stiffness;
    if (node.is_fixed) local.system.fix(i);
  }
  for (std::size_t l = 0; l < links.size(); ++l) {
    local.system.rest_length[static_cast<Eigen::Index>(l)] = links[l].rest_length;
    local.system.link_stiffness[static_cast<Eigen::Index>(l)] = links[l].stiffness;
  }
  fetch_ghosts(comm, local);
  return local;
}

template Message share_problem(const SystemShare<2>&, std::int64_t, std::int64_t);
template Message share_problem(const SystemShare<3>&, std::int64_t, std::int64_t);
template LocalSystem<2> partition(const Communicator&, const SystemShare<2>&);
template LocalSystem<3> partition(const Communicator&, const SystemShare<3>&);

}  // namespace detail::distributed
}  // namespace ASTERISM_ABI
}  // namespace asterism
