"""Convolutional detectors: `BoresightP2`, made for the speed of one CPU thread, `BoresightP2Roi`, which looks a second
time at what that one found, and the baseline `YoloN`.

Every model here keeps to the protocol of `models.py`: `loss(images, targets)`, `decode(images)`, `name`, `stride`,
`min_side_px`, `fixed_size`.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from verdict import any_of, verdict

DETECTIONS = 64  # rows that `decode` returns
Target = dict[str, Tensor]


def together(targets: list[Target], key: str, device: torch.device) -> Tensor:
    """A tensor of all targets of a batch, one after the other; `aims` that nobody knows are no numbers."""
    unknown = lambda t: torch.full((len(t["boxes"]), 2), math.nan)  # noqa: E731
    return torch.cat([t[key] if key in t or key != "aims" else unknown(t) for t in targets]).to(device)


def conv(c_in: int, c_out: int, kernel: int = 3, stride: int = 1, act: nn.Module | None = None) -> nn.Sequential:
    """Convolution, batch normalisation (folded at export), activation (ReLU unless given)."""
    return nn.Sequential(
        nn.Conv2d(c_in, c_out, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(c_out, eps=1e-3, momentum=0.03),
        nn.ReLU(inplace=True) if act is None else act,
    )


class Residual(nn.Module):
    """Two 3x3 convolutions and a short cut."""

    def __init__(self, channels: int):
        super().__init__()
        self.a, self.b = conv(channels, channels), conv(channels, channels, act=nn.Identity())

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.b(self.a(x)))


def box_iou_terms(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """IoU, and squared centre distance over the squared diagonal of the common hull (DIoU: Zheng et al. 2020),
    of boxes x0, y0, x1, y1 row by row."""
    low, high = torch.maximum(a[..., :2], b[..., :2]), torch.minimum(a[..., 2:], b[..., 2:])
    inner = (high - low).clamp(min=0).prod(-1)
    union = (a[..., 2:] - a[..., :2]).prod(-1) + (b[..., 2:] - b[..., :2]).prod(-1) - inner
    hull = torch.maximum(a[..., 2:], b[..., 2:]) - torch.minimum(a[..., :2], b[..., :2])
    shift = (a[..., :2] + a[..., 2:] - b[..., :2] - b[..., 2:]) / 2
    return inner / union.clamp(min=1e-6), shift.pow(2).sum(-1) / hull.pow(2).sum(-1).clamp(min=1e-6)


def nwd(a: Tensor, b: Tensor, c_px: float | Tensor) -> Tensor:
    """Normalised Wasserstein distance of boxes x0, y0, x1, y1 as Gaussians (Wang et al. 2021): 1 is identity."""
    centre = (a[..., :2] + a[..., 2:] - b[..., :2] - b[..., 2:]) / 2
    half = (a[..., 2:] - a[..., :2] - b[..., 2:] + b[..., :2]) / 2
    return torch.exp(-(centre.pow(2).sum(-1) + half.pow(2).sum(-1) + 1e-6).sqrt() / c_px)


def rows_at(rows: Tensor, index: Tensor) -> Tensor:
    """Rows [B,K,...] of [B,N] or [B,N,C] at `index` [B,K]."""
    return rows.gather(1, index if rows.ndim == 2 else index[..., None].expand(-1, -1, rows.shape[2]))


def suppress(boxes: Tensor, scores: Tensor, overlap: float) -> Tensor:
    """Scores [B,N] with those of boxes [B,N,4] that overlap a better one (IoU above `overlap`) set to 0, where they fall
    to begin with; traceable, one pass."""
    one, other = boxes[:, :, None], boxes[:, None]
    low, high = torch.maximum(one[..., :2], other[..., :2]), torch.minimum(one[..., 2:], other[..., 2:])
    inner = (high - low).clamp(min=0).prod(-1)
    area = (boxes[..., 2:] - boxes[..., :2]).prod(-1)
    same = inner > overlap * (area[:, :, None] + area[:, None] - inner)
    rank = torch.arange(boxes.shape[1], device=boxes.device)
    beaten = (same & (rank[None] < rank[:, None])).to(scores.dtype).amax(2)
    return scores * (1 - beaten)


class BoresightP2(nn.Module):
    """One head at 1/4 resolution: heat map of target centres, centre offset and log size, class.

    Memory traffic at 1/4 is what costs time on a CPU, so only the stem and one convolution of the head work there;
    branches at 1/8, 1/16 and 1/32 think, and come back by upsampling and adding.
    """

    stride, min_side_px, fixed_size = 32, 64, None
    cell = 4  # [px] of the head's grid
    tells_class = True  # the maps hold class and aim point, too

    def __init__(self, name: str = "boresight-p2", num_classes: int = 8, widths: tuple[int, ...] = (16, 32, 48, 64), head: int = 32):
        super().__init__()
        self.name, self.num_classes = name, num_classes
        w1, w2, w3, w4 = widths  # at 1/2, 1/4, 1/8, and at 1/16 and 1/32
        self.stem = nn.Sequential(conv(3, w1, 3, 2), conv(w1, w2, 3, 2))
        self.down3 = nn.Sequential(conv(w2, w3, 3, 2), Residual(w3))
        self.down4 = nn.Sequential(conv(w3, w4, 3, 2), Residual(w4))
        self.down5 = nn.Sequential(conv(w4, w4, 3, 2), Residual(w4))
        self.lateral4, self.fuse4 = conv(w4, w4, 1, act=nn.Identity()), conv(w4, w4)
        self.lateral3, self.fuse3 = conv(w4, w3, 1, act=nn.Identity()), conv(w3, w3)
        self.lateral2, self.head = conv(w3, w2, 1, act=nn.Identity()), conv(w2, head)
        self.out = nn.Conv2d(head, 1 + 4 + (num_classes if self.tells_class else 0), 1)
        nn.init.normal_(self.out.weight, std=0.01)
        with torch.no_grad():
            self.out.bias.zero_()
            self.out.bias[0] = -4.6  # prior of 1 % for a cell to hold a centre
            self.out.bias[3:5] = math.log(12.0 / self.cell)  # log of the size in cells
        if self.tells_class:
            self.aim = nn.Conv2d(head, 2, 1)
            nn.init.zeros_(self.aim.weight)

    def forward(self, images: Tensor) -> Tensor:
        """Raw maps [B, 1 + 4 + classes + 2, H/4, W/4]: heat logit, offset x, y [cells], log width, height [cells],
        classes, the body's middle from the box's x, y [cells]."""
        return self.maps(self.features(images))

    def maps(self, seen: Tensor) -> Tensor:
        """Raw maps of what the head sees."""
        return torch.cat([self.out(seen), self.aim(seen)], 1) if self.tells_class else self.out(seen)

    def features(self, images: Tensor) -> Tensor:
        """What the head sees at 1/4."""
        p2 = self.stem(images)
        p3 = self.down3(p2)
        p4 = self.down4(p3)
        p5 = self.down5(p4)
        p4 = self.fuse4(F.relu(p4 + self.up(self.lateral4(p5))))
        p3 = self.fuse3(F.relu(p3 + self.up(self.lateral3(p4))))
        return self.head(p2 + self.up(self.lateral2(p3)))

    @staticmethod
    def up(x: Tensor) -> Tensor:
        return F.interpolate(x, scale_factor=2.0, mode="nearest")

    def boxes(self, raw: Tensor, x: Tensor, y: Tensor) -> Tensor:
        """Boxes [...,4] in pixels of raw rows [..., >=5] at cells (x, y)."""
        centre = torch.stack([x + 0.5, y + 0.5], -1) + raw[..., 1:3]
        half = raw[..., 3:5].clamp(-3.0, 4.5).exp() / 2
        return torch.cat([centre - half, centre + half], -1) * self.cell

    def loss(self, images: Tensor, targets: list[Target]) -> dict[str, Tensor]:
        """Penalty-reduced focal loss of the heat map (CenterNet: Zhou et al. 2019), DIoU + NWD of the boxes at the
        cells about each centre, cross entropy of the classes."""
        return self.dense_loss(self(images).float(), targets)

    def dense_loss(self, raw: Tensor, targets: list[Target]) -> dict[str, Tensor]:
        """The loss of raw maps."""
        batch, _, rows, cols = raw.shape
        device = raw.device
        heat = torch.zeros(batch, rows, cols)
        care = torch.ones(batch, rows, cols)
        picks: list[Tensor] = []  # image, y, x, target index
        weights: list[Tensor] = []
        offset = 0
        for b, target in enumerate(targets):
            for box in target.get("ignore", torch.zeros(0, 4)).tolist():
                x0, y0 = (max(0, math.floor(v / self.cell) - 1) for v in box[:2])
                x1, y1 = (math.ceil(v / self.cell) + 1 for v in box[2:])
                care[b, y0:y1, x0:x1] = 0
            for box in target["boxes"].tolist():
                cx, cy = (box[0] + box[2]) / 2 / self.cell, (box[1] + box[3]) / 2 / self.cell
                ix, iy = min(max(int(cx), 0), cols - 1), min(max(int(cy), 0), rows - 1)
                size = math.sqrt(max(box[2] - box[0], 1) * max(box[3] - box[1], 1)) / self.cell
                sigma = max(0.6, 0.16 * size)
                reach = math.ceil(3 * sigma)
                x0, x1, y0, y1 = max(0, ix - reach), min(cols, ix + reach + 1), max(0, iy - reach), min(rows, iy + reach + 1)
                xs, ys = torch.arange(x0, x1), torch.arange(y0, y1)
                bump = torch.exp(-((xs + 0.5 - cx) ** 2 + (ys[:, None] + 0.5 - cy) ** 2) / (2 * sigma**2))
                patch = heat[b, y0:y1, x0:x1]
                torch.maximum(patch, bump, out=patch)
                heat[b, iy, ix] = 1
                care[b, iy, ix] = 1
                near = ((xs - ix).abs() <= 1)[None] & ((ys - iy).abs() <= 1)[:, None] & (bump > 0.2)
                near[iy - y0, ix - x0] = True
                yy, xx = near.nonzero(as_tuple=True)
                w = bump[yy, xx].clamp(min=0.2)
                picks.append(torch.stack([torch.full_like(yy, b), yy + y0, xx + x0, torch.full_like(yy, offset)], 1))
                weights.append(w / w.sum())
                offset += 1
        heat, care = heat.to(device), care.to(device)
        logit = raw[:, 0]
        p = logit.sigmoid()
        positive = heat == 1
        loss_pos = -((1 - p) ** 2 * F.logsigmoid(logit))[positive].sum()
        loss_neg = -((1 - heat) ** 4 * p**2 * F.logsigmoid(-logit) * care * ~positive).sum()
        count = max(offset, 1)
        # Per batch, not per image: pictures without a target still teach.
        losses = {"heat": (loss_pos + loss_neg) / max(count, batch / 4)}
        if offset:
            pick, weight = torch.cat(picks).to(device), torch.cat(weights).to(device)
            truth, labels, aims = (together(targets, key, device)[pick[:, 3]] for key in ("boxes", "labels", "aims"))
            rows_raw = raw[pick[:, 0], :, pick[:, 1], pick[:, 2]]
            predicted = self.boxes(rows_raw, pick[:, 2].float(), pick[:, 1].float())
            iou, apart = box_iou_terms(predicted, truth)
            scale = (truth[:, 2:] - truth[:, :2]).prod(-1).clamp(min=9).sqrt()
            losses["box"] = (weight * (1 - iou + apart)).sum() / count
            losses["nwd"] = (weight * (1 - nwd(predicted, truth, 0.5 * scale))).sum() / count
            losses["total"] = losses["heat"] + 1.5 * losses["box"] + losses["nwd"]
            if self.tells_class:
                losses["class"] = (weight * F.cross_entropy(rows_raw[:, 5:-2], labels, reduction="none")).sum() / count
                # The body's middle is known of rendered targets only, and the box's has its own losses.
                known = aims.isfinite().all(1)
                middle = (predicted[:, :2] + predicted[:, 2:]).detach() / 2
                miss = (middle + rows_raw[:, -2:] * self.cell - aims.nan_to_num()).abs().sum(-1) / scale
                losses["aim"] = (weight * miss * known).sum() / count
                losses["total"] = losses["total"] + 0.7 * losses["class"] + losses["aim"]
        else:
            losses["total"] = losses["heat"] + 0 * raw[:, 1:].sum()
        return losses

    def decode(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Boxes [B,N,4] px, scores [B,N] falling, labels int64 [B,N], bodies' middles [B,N,2] px: peaks of the heat
        map, best first."""
        boxes, heat, rows = self.peaks(self(images), DETECTIONS)
        middles = (boxes[..., :2] + boxes[..., 2:]) / 2 + rows[..., -2:] * self.cell
        labels, share = verdict(rows[..., 5:-2].softmax(-1))
        scores, best = (heat * share).topk(DETECTIONS)
        boxes, labels, middles = (rows_at(x, best) for x in (boxes, labels, middles))
        scores, order = suppress(boxes, scores, 0.4).topk(DETECTIONS)
        return rows_at(boxes, order), scores, rows_at(labels, order), rows_at(middles, order)

    def peaks(self, raw: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
        """Boxes [B,count,4] px, scores [B,count] falling and rows [B,count,channels] of the maps' highest peaks."""
        cols = raw.shape[3]
        p = raw[:, :1].sigmoid()
        peak = p * (p == F.max_pool2d(p, 3, 1, 1)).to(p.dtype)
        scores, index = peak.flatten(1).topk(count)
        rows = raw.flatten(2).gather(2, index[:, None].expand(-1, raw.shape[1], -1)).transpose(1, 2)
        y = torch.div(index, cols, rounding_mode="floor")
        return self.boxes(rows, (index - y * cols).to(raw.dtype), y.to(raw.dtype)), scores, rows


class BoresightP2Roi(BoresightP2):
    """`BoresightP2` whose maps hold only heat and box, and a second stage on what it found (as in Faster R-CNN: Ren et
    al. 2015): the picture itself is sampled anew about each peak, at the peak's own scale, and a small network of its
    own tells from it and from the features at 1/4 the quality (expected IoU), a better box, the class and the body's
    middle. The score is the geometric mean of heat and quality, times the share that UAVs, or all else, have in the classes.
    What is not small gets a third look: what the second sees some 15 samples wide, it sees 30 wide, and corrects quality and class.

    A bird and a UAV of 12 px differ in details that no map at 1/4 can hold at its price; on a few peaks they are cheap. An
    aeroplane of 60 px shows its engines, but not to 15 samples. Tried before: 7 x 7 samples of the stem's features, 4 px apart.
    """

    tells_class = False
    looks = (6, 24)  # highest peaks that get a second look in the smallest and in a large picture, at most
    look_area = 8192  # [px] of picture a look, between them: a look costs what some 3,500 px of maps cost
    always = 8  # of them that get one whatever their heat: in validation pictures more find nothing
    likely = 0.25  # heat from which on more get one, as in a swarm (empty ones reach 0.1 to 0.2 before city and woods)
    grid = 24  # samples a side of the picture, and a quarter as many of the features
    taught = 12  # highest peaks of a picture that the second stage learns from
    close = 2  # peaks that get the third look
    close_grid = 48  # samples a side of it
    close_px = (14.0, 22.0)  # longer side from which on it counts at all, and in full: where 15 samples begin to lose pixels

    def __init__(self, name: str = "boresight-p2-roi", num_classes: int = 8, widths: tuple[int, ...] = (16, 32, 48, 64), head: int = 32):
        super().__init__(name, num_classes, widths, head)
        self.view = nn.Sequential(conv(6, 32, 5, 2), Residual(32), conv(32, 48, 3, 2))
        self.join = conv(48 + head, 64)
        self.think = nn.Linear(64 * (self.grid // 8) ** 2 + 6, 96)
        self.say = nn.Linear(96, 1 + 4 + num_classes + 2)
        nn.init.normal_(self.say.weight, std=0.01)
        nn.init.zeros_(self.say.bias)
        self.closer = nn.ModuleDict({
            "view": nn.Sequential(conv(6, 24, 5, 2), conv(24, 32, 3, 2), Residual(32), conv(32, 48, 3, 2), nn.MaxPool2d(2), nn.Flatten()),
            "think": nn.Linear(48 * (self.close_grid // 16) ** 2 + 1, 64),
            "say": nn.Linear(64, 1 + num_classes),
        })  # fmt: skip
        nn.init.zeros_(self.closer["say"].weight)
        nn.init.zeros_(self.closer["say"].bias)

    @staticmethod
    def samples(maps: Tensor, corner: Tensor, window: Tensor, count: int, size: tuple[int, int]) -> Tensor:
        """[B*K,C,count,count]: maps [B,C,h,w] over pictures of `size` (height, width) [px], sampled bilinearly at the
        middles of count x count cells of square windows with upper left corners [B,K,2] and sides [B,K,1] px."""
        steps = (torch.arange(count, device=corner.device) + 0.5) / count
        x = (2 * (corner[..., :1] + window * steps) / size[1] - 1)[..., None, :]  # [B,K,1,count]
        y = (2 * (corner[..., 1:] + window * steps) / size[0] - 1)[..., None]  # [B,K,count,1]
        where = torch.stack([x + 0 * y, y + 0 * x], -1).flatten(2, 3)  # [B,K,count^2,2]
        seen = F.grid_sample(maps.float(), where, align_corners=False).transpose(1, 2)  # [B,K,C,count^2]
        return seen.reshape(-1, maps.shape[1], count, count)

    def picture(self, images: Tensor, corner: Tensor, window: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
        """What windows show, fine and, for targets of more than some 20 px, free of aliasing, by the contrast of the fine
        view [B*K,6,count,count]; its level [B*K,3,1,1] and contrast [B*K,1,1,1]."""
        size = images.shape[-2:]
        sharp, soft = (self.samples(x, corner, window, count, size) for x in (images, F.avg_pool2d(images, 4)))
        level = sharp.mean((2, 3), keepdim=True)
        contrast = ((sharp - level).square().mean((1, 2, 3), keepdim=True) + 1e-5).sqrt()
        return torch.cat([sharp - level, soft - level], 1) / contrast, level, contrast

    def second(self, images: Tensor, features: Tensor, boxes: Tensor, logits: Tensor) -> tuple[Tensor, ...]:
        """Quality logits [B,K], boxes [B,K,4] px, class logits [B,K,classes], middles [B,K,2] px of first boxes
        [B,K,4] px with heat logits [B,K] in pictures [B,3,H,W] with features at 1/4."""
        size = images.shape[-2:]
        middle, sides = (boxes[..., :2] + boxes[..., 2:]) / 2, boxes[..., 2:] - boxes[..., :2]
        window = 1.6 * sides.amax(-1, keepdim=True) + 6  # [px]
        at = (middle - window / 2, window)
        seen, level, contrast = self.picture(images, *at, self.grid)
        near = self.view(seen)
        near = self.join(torch.cat([near, self.samples(features, *at, self.grid // 4, size)], 1))
        near = F.max_pool2d(near, 2).flatten(1)
        context = torch.cat([(sides / window).clamp(min=0.01).log(), (window / 32).log(), logits[..., None] / 4], -1).flatten(0, 1)
        light = torch.cat([contrast.log() + 3, level.mean(1, keepdim=True)], 1).flatten(1)
        said = self.say(F.relu(self.think(torch.cat([near, context, light], 1)))).float()
        said = said.reshape(boxes.shape[0], boxes.shape[1], -1)
        middle = middle + 0.1 * window * said[..., 1:3]
        half = sides / 2 * (0.2 * said[..., 3:5]).clamp(-2, 2).exp()
        more = self.third(images, boxes, logits)
        quality, kinds = said[..., 0] + more[..., 0], said[..., 5:-2] + more[..., 1:]
        return quality, torch.cat([middle - half, middle + half], -1), kinds, middle + 0.1 * window * said[..., -2:]

    def third(self, images: Tensor, boxes: Tensor, logits: Tensor) -> Tensor:
        """What a closer look at some of the first boxes [B,K,4] px adds to the logits of quality and classes [B,K,1+classes]."""
        longer = (boxes[..., 2:] - boxes[..., :2]).amax(-1)
        least, full = self.close_px
        gate = ((longer - least) / (full - least)).clamp(0, 1)
        _, which = (gate * logits.sigmoid()).topk(self.close)
        chosen, gate = rows_at(boxes, which), gate.gather(1, which)
        window = 1.6 * (chosen[..., 2:] - chosen[..., :2]).amax(-1, keepdim=True) + 6  # [px]
        seen, _, contrast = self.picture(images, (chosen[..., :2] + chosen[..., 2:] - window) / 2, window, self.close_grid)
        known = torch.cat([self.closer["view"](seen), contrast.flatten(1).log() + 3], 1)
        said = self.closer["say"](F.relu(self.closer["think"](known))).float()
        said = said.reshape(*which.shape, -1) * gate[..., None]
        # Back to where they were chosen from; a peak is chosen once.
        return F.one_hot(which, boxes.shape[1]).to(said.dtype).transpose(1, 2) @ said

    def loss(self, images: Tensor, targets: list[Target]) -> dict[str, Tensor]:
        """The maps' loss, and of the second stage: quality focal loss towards the IoU reached (GFL: Li et al. 2020),
        DIoU + NWD, cross entropy, the middle's miss."""
        features = self.features(images)
        raw = self.maps(features).float()
        losses = self.dense_loss(raw, targets)
        first, _, rows = self.peaks(raw.detach(), self.taught)
        owner, care = self.owners(first, targets)
        wanted = torch.zeros_like(care)
        quality, refined, kinds, middles = self.second(images, features, first, rows[..., 0])
        hit = owner >= 0
        count = max(int(hit.sum()), len(targets))
        if hit.any():
            truth, labels, aims = (together(targets, key, raw.device)[owner[hit]] for key in ("boxes", "labels", "aims"))
            iou, apart = box_iou_terms(refined[hit], truth)
            wanted[hit] = iou.detach()
            scale = (truth[:, 2:] - truth[:, :2]).prod(-1).clamp(min=9).sqrt()
            losses["box2"] = (1 - iou + apart).sum() / count
            losses["nwd2"] = (1 - nwd(refined[hit], truth, 0.5 * scale)).sum() / count
            losses["class"] = F.cross_entropy(kinds[hit], labels, reduction="sum") / count
            known = aims.isfinite().all(1)
            losses["aim"] = ((middles[hit] - aims.nan_to_num()).abs().sum(-1) / scale * known).sum() / count
            losses["total"] = losses["total"] + 1.5 * losses["box2"] + losses["nwd2"] + 0.7 * losses["class"] + losses["aim"]
        p = quality.sigmoid()
        focal = F.binary_cross_entropy_with_logits(quality, wanted, reduction="none") * (p - wanted).detach().square()
        losses["quality"] = 4 * (focal * care).sum() / count
        losses["total"] = losses["total"] + losses["quality"]
        return losses

    @torch.no_grad()
    def owners(self, boxes: Tensor, targets: list[Target]) -> tuple[Tensor, Tensor]:
        """The target near whose middle each box lies (index over the batch, -1 for none), and 1 or, in regions to
        ignore, 0; both [B,K] for boxes [B,K,4] px."""
        middles = (boxes[..., :2] + boxes[..., 2:]) / 2
        owner = torch.full(boxes.shape[:2], -1, device=boxes.device)
        care = torch.ones(boxes.shape[:2], device=boxes.device)
        offset = 0
        for b, (target, middle) in enumerate(zip(targets, middles)):
            truth, ignore = (target.get(k, torch.zeros(0, 4)).to(boxes.device) for k in ("boxes", "ignore"))
            if len(ignore):
                inside = ((middle[:, None] > ignore[:, :2] - 4) & (middle[:, None] < ignore[:, 2:] + 4)).all(-1)
                care[b, inside.any(1)] = 0
            if len(truth):
                apart = (middle[:, None] - (truth[:, :2] + truth[:, 2:]) / 2).norm(dim=-1)
                reach = 0.35 * (truth[:, 2:] - truth[:, :2]).amax(-1) + 2  # [px]
                best, which = (apart / reach).min(1)
                owner[b] = torch.where(best <= 1, which + offset, owner[b])
                care[b, best <= 1] = 1
            offset += len(truth)
        return owner, care

    def decode(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """As `BoresightP2.decode`, by the second look."""
        features = self.features(images)
        # A tensor, so that a traced graph counts anew for each size of picture.
        area = torch.as_tensor(images.shape[2]) * torch.as_tensor(images.shape[3])
        most = (torch.div(area, self.look_area, rounding_mode="floor")).clamp(*self.looks)
        first, heat, rows = self.peaks(self.maps(features), most)
        looked = (torch.arange(heat.shape[1], device=heat.device) < self.always) | (heat > self.likely)
        count = looked.sum(1).amax()
        # Each picture keeps its own number, whatever else is in the batch: what is below it scores 0.
        heat, best = (heat * looked).topk(count)
        first, rows = rows_at(first, best), rows_at(rows, best)
        quality, boxes, kinds, middles = self.second(images, features, first, rows[..., 0])
        labels, share = verdict(kinds.softmax(-1))
        scores, best = ((quality.sigmoid() * heat).sqrt() * share).topk(count)
        boxes = rows_at(boxes, best)
        scores, order = suppress(boxes, scores, 0.4).topk(count)
        best = rows_at(best, order)
        return rows_at(boxes, order), scores, rows_at(labels, best), rows_at(middles, best)


# --- the baseline --------------------------------------------------------------------------------------------------


class Bottleneck(nn.Module):
    """Two 3x3 convolutions, with a short cut where asked."""

    def __init__(self, channels: int, short_cut: bool):
        super().__init__()
        self.a, self.b, self.short_cut = silu(channels, channels), silu(channels, channels), short_cut

    def forward(self, x: Tensor) -> Tensor:
        y = self.b(self.a(x))
        return x + y if self.short_cut else y


class Elan(nn.Module):
    """Cross-stage partial block whose every bottleneck is aggregated (CSPNet: Wang et al. 2020; ELAN: 2022)."""

    def __init__(self, c_in: int, c_out: int, depth: int, short_cut: bool = True):
        super().__init__()
        half = c_out // 2
        self.enter, self.leave = silu(c_in, 2 * half, 1), silu((2 + depth) * half, c_out, 1)
        self.blocks = nn.ModuleList(Bottleneck(half, short_cut) for _ in range(depth))

    def forward(self, x: Tensor) -> Tensor:
        parts = list(self.enter(x).chunk(2, 1))
        for block in self.blocks:
            parts.append(block(parts[-1]))
        return self.leave(torch.cat(parts, 1))


class PyramidPool(nn.Module):
    """Spatial pyramid pooling by three 5x5 maxima in a row (He et al. 2015)."""

    def __init__(self, channels: int):
        super().__init__()
        self.enter, self.leave = silu(channels, channels // 2, 1), silu(2 * channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        parts = [self.enter(x)]
        for _ in range(3):
            parts.append(F.max_pool2d(parts[-1], 5, 1, 2))
        return self.leave(torch.cat(parts, 1))


def silu(c_in: int, c_out: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    return conv(c_in, c_out, kernel, stride, nn.SiLU(inplace=True))


class YoloN(nn.Module):
    """A YOLO-n-class baseline written from the papers: cross-stage partial backbone, path aggregation (PANet: Liu et
    al. 2018), anchor-free decoupled heads at 1/8, 1/16 and 1/32, box sides as distributions (GFL: Li et al. 2020),
    task-aligned assignment (TOOD: Feng et al. 2021), loss weights of PP-YOLOE (Xu et al. 2022)."""

    stride, min_side_px, fixed_size = 32, 64, None
    cells = (8, 16, 32)  # [px]
    bins = 16  # of a side's distribution [cells]
    candidates = 128  # that enter suppression in `decode`

    def __init__(self, name: str = "yolo-n", num_classes: int = 8):
        super().__init__()
        self.name, self.num_classes = name, num_classes
        w = (16, 32, 64, 128, 256)
        self.p2 = nn.Sequential(silu(3, w[0], 3, 2), silu(w[0], w[1], 3, 2), Elan(w[1], w[1], 1))
        self.p3 = nn.Sequential(silu(w[1], w[2], 3, 2), Elan(w[2], w[2], 2))
        self.p4 = nn.Sequential(silu(w[2], w[3], 3, 2), Elan(w[3], w[3], 2))
        self.p5 = nn.Sequential(silu(w[3], w[4], 3, 2), Elan(w[4], w[4], 1), PyramidPool(w[4]))
        self.up4, self.up3 = Elan(w[4] + w[3], w[3], 1, False), Elan(w[3] + w[2], w[2], 1, False)
        self.to4, self.down4 = silu(w[2], w[2], 3, 2), Elan(w[2] + w[3], w[3], 1, False)
        self.to5, self.down5 = silu(w[3], w[3], 3, 2), Elan(w[3] + w[4], w[4], 1, False)
        self.sides, self.kinds = nn.ModuleList(), nn.ModuleList()
        for k, channels in enumerate(w[2:]):
            sides = nn.Conv2d(64, 4 * self.bins, 1)
            kinds = nn.Conv2d(64, num_classes, 1)
            with torch.no_grad():
                # Short sides first: a flat distribution would start with boxes of 15 cells, far from any target.
                sides.bias.copy_(-0.7 * torch.arange(self.bins).float().repeat(4))
                kinds.bias.fill_(math.log(5 / num_classes / (640 / self.cells[k]) ** 2))
            self.sides.append(nn.Sequential(silu(channels, 64), silu(64, 64), sides))
            self.kinds.append(nn.Sequential(silu(channels, 64, 1), depthwise(64), silu(64, 64, 1), depthwise(64), kinds))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Side logits [B,A,4,bins], class logits [B,A,classes], cell centres and pitch [A,3] px."""
        p3 = self.p3(self.p2(images))
        p4 = self.p4(p3)
        p5 = self.p5(p4)
        n4 = self.up4(torch.cat([F.interpolate(p5, scale_factor=2.0), p4], 1))
        n3 = self.up3(torch.cat([F.interpolate(n4, scale_factor=2.0), p3], 1))
        n4 = self.down4(torch.cat([self.to4(n3), n4], 1))
        n5 = self.down5(torch.cat([self.to5(n4), p5], 1))
        sides, kinds, grid = [], [], []
        for x, side, kind, cell in zip((n3, n4, n5), self.sides, self.kinds, self.cells):
            sides.append(side(x).flatten(2).transpose(1, 2))
            kinds.append(kind(x).flatten(2).transpose(1, 2))
            rows, cols = x.shape[2], x.shape[3]
            index = torch.arange(rows * cols, device=x.device)
            row = torch.div(index, cols, rounding_mode="floor")
            col = index - row * cols
            grid.append(torch.stack([(col + 0.5) * cell, (row + 0.5) * cell, torch.full_like(col, cell).float()], 1))
        side = torch.cat(sides, 1)
        return side.reshape(side.shape[0], -1, 4, self.bins), torch.cat(kinds, 1), torch.cat(grid)

    def boxes(self, sides: Tensor, grid: Tensor) -> Tensor:
        """Boxes [B,A,4] in pixels: mean of each side's distribution about the middles of cells [A,3] or [B,A,3]."""
        reach = sides.softmax(-1) @ torch.arange(self.bins, dtype=sides.dtype, device=sides.device)
        reach = reach * grid[..., 2:]
        return torch.cat([grid[..., :2] - reach[..., :2], grid[..., :2] + reach[..., 2:]], -1)

    @torch.no_grad()
    def assign(self, predicted: Tensor, prob: Tensor, grid: Tensor, truth: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
        """Index of the target of each cell, -1 for none, and its wanted score, for one picture."""
        # A target smaller than a cell would hold no cell's middle: each is taken to be a cell wide at least.
        middle, half = (truth[:, :2] + truth[:, 2:]) / 2, (truth[:, 2:] - truth[:, :2]) / 2
        half = torch.maximum(half[:, None], grid[None, :, 2:] / 2)
        inside = ((grid[None, :, :2] - middle[:, None]).abs() <= half).all(-1)
        iou, _ = box_iou_terms(predicted[None].expand(len(truth), -1, -1), truth[:, None].expand(-1, len(grid), -1))
        score = prob[:, labels].T
        metric = score * iou.pow(6) + 1e-12  # alpha 1, beta 6 (TOOD)
        metric = metric * inside
        chosen = torch.zeros_like(inside)
        chosen.scatter_(1, metric.topk(min(13, metric.shape[1]), 1).indices, True)
        chosen &= inside
        rank = torch.where(chosen, iou + 1e-3, torch.zeros_like(iou))  # a cell of several targets: the best fit
        best, owner = rank.max(0)
        owner = torch.where(best > 0, owner, torch.full_like(owner, -1))
        own = chosen & (owner[None] == torch.arange(len(truth), device=truth.device)[:, None])
        metric, fit = metric * own, (iou * own).amax(1, keepdim=True)
        wanted = metric / metric.amax(1, keepdim=True).clamp(min=1e-12) * fit.clamp(min=0.1)
        return owner, wanted.amax(0)

    def loss(self, images: Tensor, targets: list[Target]) -> dict[str, Tensor]:
        """Binary cross entropy towards the aligned scores; CIoU and distribution focal loss of the assigned cells."""
        sides, kinds, grid = self(images)
        sides, kinds = sides.float(), kinds.float()
        boxes, prob = self.boxes(sides, grid), kinds.sigmoid()
        wanted = torch.zeros_like(kinds)
        care = torch.ones_like(kinds[..., :1])
        taken: list[tuple[Tensor, ...]] = []
        for b, target in enumerate(targets):
            ignore = target.get("ignore", torch.zeros(0, 4)).to(grid.device)
            if len(ignore):
                inside = ((grid[None, :, :2] > ignore[:, None, :2] - 4) & (grid[None, :, :2] < ignore[:, None, 2:] + 4)).all(-1)
                care[b, inside.any(0)] = 0
            truth, labels = target["boxes"].to(grid.device), target["labels"].to(grid.device)
            if not len(truth):
                continue
            owner, score = self.assign(boxes[b].detach(), prob[b].detach(), grid, truth, labels)
            cell = (owner >= 0).nonzero()[:, 0]
            wanted[b, cell, labels[owner[cell]]] = score[cell]
            care[b, cell] = 1
            taken.append((sides[b, cell], boxes[b, cell], grid[cell], truth[owner[cell]], score[cell]))
        total = wanted.sum().clamp(min=1)
        losses = {"class": (F.binary_cross_entropy_with_logits(kinds, wanted, reduction="none") * care).sum() / total}
        if taken:
            side, box, at, truth, score = (torch.cat(x) for x in zip(*taken))
            iou, apart = box_iou_terms(box, truth)
            a, b = box[:, 2:] - box[:, :2], truth[:, 2:] - truth[:, :2]
            shape = (torch.atan2(b[:, 0], b[:, 1]) - torch.atan2(a[:, 0], a[:, 1].clamp(min=1e-6))).pow(2) * 4 / math.pi**2
            weight = (shape / (1 - iou + shape + 1e-6)).detach()
            losses["box"] = ((1 - iou + apart + weight * shape) * score).sum() / total  # CIoU: Zheng et al. 2020
            reach = torch.cat([at[:, :2] - truth[:, :2], truth[:, 2:] - at[:, :2]], 1) / at[:, 2:]
            reach = reach.clamp(0, self.bins - 1.01)
            low = reach.long()
            up = reach - low
            log = side.log_softmax(-1)
            dfl = -(log.gather(-1, low[..., None])[..., 0] * (1 - up) + log.gather(-1, low[..., None] + 1)[..., 0] * up)
            losses["distribution"] = (dfl.mean(-1) * score).sum() / total
            losses["total"] = losses["class"] + 2.5 * losses["box"] + 0.5 * losses["distribution"]
        else:
            losses["total"] = losses["class"] + 0 * sides.sum()
        return losses

    def decode(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Boxes [B,N,4] px, scores [B,N] falling, labels int64 [B,N], overlapping ones suppressed."""
        sides, kinds, grid = self(images)
        labels, scores = any_of(kinds.sigmoid())
        scores, index = scores.topk(self.candidates)
        near = rows_at(sides.flatten(2), index).unflatten(2, (4, self.bins))
        boxes = self.boxes(near, grid[index])
        scores, order = suppress(boxes, scores, 0.5).topk(DETECTIONS)
        return rows_at(boxes, order), scores, rows_at(rows_at(labels, index), order)


def depthwise(channels: int) -> nn.Sequential:
    """A 3x3 convolution of each channel by itself."""
    return nn.Sequential(
        nn.Conv2d(channels, channels, 3, 1, 1, groups=channels, bias=False),
        nn.BatchNorm2d(channels, eps=1e-3, momentum=0.03),
        nn.SiLU(inplace=True),
    )
