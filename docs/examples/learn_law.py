"""Learns the law k_ij = exp(p) strain^q of links' stiffness from the true places of parts; needs PyTorch."""

import asterism
import asterism.torch
import torch

torch.manual_seed(1)
topology = asterism.Topology.full(4)
i, j = torch.tensor(topology.links).long().T
shape = torch.tensor([[0.0, 0], [40, 0], [0, 40], [40, 40]], dtype=torch.float64)
anchors = shape + 3 * torch.randn(32, 4, 2, dtype=torch.float64)  # 32 frames, each part found 3 px off
rest_length = (shape[i] - shape[j]).norm(dim=1)
stiffness = torch.ones(4, dtype=torch.float64)
strain = ((anchors[:, i] - anchors[:, j]).norm(dim=2) - rest_length).abs() / rest_length


def placements(law):
    return asterism.torch.solve(topology, anchors, stiffness, rest_length, torch.exp(law[0]) * strain ** law[1])


with torch.no_grad():
    truth = placements(torch.tensor([1.5, 0.8], dtype=torch.float64))  # of a law that is to be found again
law = torch.zeros(2, dtype=torch.float64, requires_grad=True)
optimiser = torch.optim.LBFGS([law], max_iter=50, line_search_fn="strong_wolfe")


def loss():
    optimiser.zero_grad()
    value = (placements(law) - truth).square().mean()
    value.backward()
    return value


optimiser.step(loss)
print(f"p = {law[0].item():.4f}, q = {law[1].item():.4f}")
