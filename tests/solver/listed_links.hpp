#pragma once

// A system of the same springs over a list of links: what walks over springs one by one, the oracle of what
// takes all pairs of nodes at once.

namespace asterism::testing {

template <typename System>
System with_listed_links(const System& system) {
  System listed(System::TopologyType::from_links(system.nodes(), system.topology().links()));
  listed.anchors = system.anchors;
  listed.anchor_stiffness = system.anchor_stiffness;
  listed.rest_length = system.rest_length;
  listed.link_stiffness = system.link_stiffness;
  listed.loads = system.loads;
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) listed.fix(i);
  }
  return listed;
}

}  // namespace asterism::testing
