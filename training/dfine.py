"""The four D-FINE rows of the paper's Table 1, on the D-FINE building blocks of `transformers` (Apache-2.0).

`build_dfine(name)` gives, with random weights and without any download:

- `d-fine`: the released D-FINE-N (HGNetv2-B0, P4 + P5, hidden 128, 3 decoder layers), L1 + GIoU loss;
- `d-fine-nwd`: the same network, the normalised Wasserstein distance (NWD) as its regression loss and match cost;
- `d-fine-nwd-p2`: HGNetv2-B0 cut after stage 2, P2 (1/4) and P3 (1/8) only, hidden 64, no attention encoder, and the
  paper's fusion F = Conv1x1(P2 + Up(P3));
- `d-fine-nwd-p2-dsam`: the same with the dynamic spatial attention of the paper's Figure 5 on F.

Loss (section 4): 1.0 classification + 5.0 regression + 1.5 GO-LSD. Classification is D-FINE's varifocal loss in all
four rows (the paper says "focal"); GO-LSD is D-FINE's decoupled distillation focal loss (1.5, as released), with the
fine-grained localisation loss (0.15) that it needs. Regression is 5.0 L1 + 2.0 GIoU as released, or 5.0 NWD alone.

Pixels: D-FINE normalises boxes by the image size, so a network trained on 256 px crops would meet other box sizes,
other query positions and another pixels-per-logit slope (d cx = cx (1 - cx) W d logit) in a 640 px frame. Here all
boxes are normalised by one canvas, 640 x 512 px, in training and afterwards: a crop lies at a random place on it.

That slope is 160 px at the middle: a step of the optimiser that suits the other weights throws all centres by several
pixels together, off targets of 8 px, and P4 + P5 never find back. So centres are moved in units of anchors (`InAnchors`).
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from scipy.optimize import linear_sum_assignment
from transformers import DFineConfig, HGNetV2Config
from transformers.image_transforms import center_to_corners_format, corners_to_center_format
from transformers.loss.loss_d_fine import DFineLoss
from transformers.loss.loss_for_object_detection import generalized_box_iou
from transformers.modeling_outputs import BaseModelOutput
from transformers.models.d_fine.modeling_d_fine import (
    DFineConvNormLayer,
    DFineMLP,
    DFineModel,
    DFineRepNCSPELAN4,
    DFineSCDown,
    multi_scale_deformable_attention_v2,
)

from convnets import box_iou_terms, rows_at
from verdict import any_of

NAMES = ("d-fine", "d-fine-nwd", "d-fine-nwd-p2", "d-fine-nwd-p2-dsam")
FIXED_SIZE = (512, 640)  # [px] height and width of the canvas and of the exported input
QUERIES = 100  # D-FINE has 300; a frame here holds few targets
DENOISING_QUERIES = 10  # 100 doubles the step's time at one target an image
SCORE_PRIOR = 0.01  # score of every query before training (focal-loss initialisation)
NWD_WEIGHT = 5.0  # lambda_reg of the paper


# --- Geometry: one canvas for crops and frames -----------------------------------------------------------------------


class Canvas:
    """The 640 x 512 px plane by which all boxes are normalised, and where the current images lie on it.

    Its methods take the places of D-FINE's anchors, deformable sampling and position embedding. They are bound
    methods, not closures, so that a deep copy of a model (an EMA) uses its own canvas.
    """

    def __init__(self, anchor_px: float):
        self.anchor_px = anchor_px  # side of the anchors of the finest level [px]; each coarser level doubles it
        self.place((0, 0), FIXED_SIZE, FIXED_SIZE)

    def place(self, offset: tuple[int, int], frame: tuple[int, int], size: tuple[int, int]) -> None:
        """Lays images of `frame` (height, width) with their top left corner at `offset` (y, x) on `size` [px]."""
        self.offset, self.frame, self.size = offset, frame, size

    def whole(self, frame: tuple[int, int]) -> None:
        """Lays images at the origin; a canvas smaller than they are grows."""
        self.place((0, 0), frame, tuple(max(c, f) for c, f in zip(FIXED_SIZE, frame)))

    def anywhere(self, frame: tuple[int, int]) -> None:
        """Lays images at a random whole-pixel place, drawn from torch's generator."""
        self.whole(frame)
        free = [c - f for c, f in zip(self.size, frame)]
        self.place(tuple(int(torch.randint(0, n + 1, ())) for n in free), frame, self.size)

    def normalise(self, boxes_px: Tensor) -> Tensor:
        """Boxes xyxy in image pixels -> cx, cy, w, h in units of the canvas."""
        (oy, ox), (h, w) = self.offset, self.size
        corners = (boxes_px + boxes_px.new_tensor([ox, oy, ox, oy])) / boxes_px.new_tensor([w, h, w, h])
        return corners_to_center_format(corners)

    def pixels(self, boxes: Tensor) -> Tensor:
        """Boxes cx, cy, w, h in units of the canvas -> xyxy in image pixels, cut off at the image's edges."""
        (oy, ox), (h, w), (fh, fw) = self.offset, self.size, self.frame
        scale, shift = boxes.new_tensor([w, h, w, h]), boxes.new_tensor([ox, oy, ox, oy])
        corners = center_to_corners_format(boxes) * scale - shift
        return torch.minimum(corners.clamp(min=0.0), boxes.new_tensor([fw, fh, fw, fh]))

    def anchors(self, spatial_shapes, device="cpu", **_) -> tuple[Tensor, Tensor]:
        """Logits of the anchors [1, cells, 4] and which of them count: all, also those at the edge, where UAVs enter.

        Takes the place of `DFineModel.generate_anchors`, whose anchors have a size relative to the image. Single
        precision even where the features are bfloat16, which holds the canvas's positions to 2 px only.
        """
        (oy, ox), (h, w), (fh, fw) = self.offset, self.size, self.frame
        levels = []
        for level, (rows, columns) in enumerate((int(r), int(c)) for r, c in spatial_shapes):
            y = (oy + (torch.arange(rows, dtype=torch.float32) + 0.5) * (fh / rows)) / h
            x = (ox + (torch.arange(columns, dtype=torch.float32) + 0.5) * (fw / columns)) / w
            side = self.anchor_px * 2.0**level
            grid_y, grid_x = torch.meshgrid(y, x, indexing="ij")
            sides = [torch.full_like(grid_x, side / w), torch.full_like(grid_x, side / h)]
            levels.append(torch.stack([grid_x, grid_y, *sides], -1).reshape(1, -1, 4))
        logits = torch.logit(torch.cat(levels, 1)).to(device)
        return logits, torch.ones_like(logits[..., :1], dtype=torch.bool)

    def sample(self, value, spatial_shapes, locations, weights, points, method="default") -> Tensor:
        """Deformable attention at `locations` on the canvas; outside of the image it reads zeros."""
        (oy, ox), (h, w), (fh, fw) = self.offset, self.size, self.frame
        locations = locations * locations.new_tensor([w / fw, h / fh]) - locations.new_tensor([ox / fw, oy / fh])
        return multi_scale_deformable_attention_v2(value, spatial_shapes, locations, weights, points, method)


class CanvasPositions(nn.Module):
    """D-FINE's sine position embedding of the coarsest level, counted in cells from the canvas's origin."""

    def __init__(self, channels: int, canvas: Canvas, temperature: float = 10000.0):
        super().__init__()
        self.channels, self.canvas, self.temperature = channels, canvas, temperature

    def forward(self, width: int, height: int, device=None, dtype=torch.float32) -> Tensor:
        width, height, quarter = int(width), int(height), self.channels // 4
        omega = self.temperature ** -(torch.arange(quarter, dtype=torch.float64) / quarter)
        (oy, ox), (fh, fw) = self.canvas.offset, self.canvas.frame
        y = torch.arange(height, dtype=torch.float64) + oy * height / fh
        x = torch.arange(width, dtype=torch.float64) + ox * width / fw
        y = (y[:, None] * omega)[:, None].expand(height, width, quarter)
        x = (x[:, None] * omega)[None].expand(height, width, quarter)
        table = torch.cat([y.sin(), y.cos(), x.sin(), x.cos()], -1)
        return table.reshape(1, height * width, self.channels).to(device, dtype)


# --- Network ---------------------------------------------------------------------------------------------------------


class DSAM(nn.Module):
    """Dynamic spatial attention (paper, Figure 5): Out = X * Ah * Aw * Ac.

    Ah = sigmoid(Wh * mean over w + bh) [B,C,H,1], Aw = sigmoid(Ww * mean over h + bw) [B,C,1,W], both grouped
    convolutions along their axis, Ac = sigmoid(W2 ReLU(W1 GAP(X) + b1) + b2) [B,C,1,1]. The paper gives neither the
    kernel nor the groups nor the compression ratio r: assumed are 7 samples (28 px at 1/4), one group a channel, 4.
    """

    def __init__(self, channels: int, kernel: int = 7, ratio: int = 4):
        super().__init__()
        self.along_h = nn.Conv2d(channels, channels, (kernel, 1), padding=(kernel // 2, 0), groups=channels)
        self.along_w = nn.Conv2d(channels, channels, (1, kernel), padding=(0, kernel // 2), groups=channels)
        self.squeeze = nn.Conv2d(channels, channels // ratio, 1)
        self.excite = nn.Conv2d(channels // ratio, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        rows = x.mean(3, keepdim=True)
        a_h = self.along_h(rows).sigmoid()
        a_w = self.along_w(x.mean(2, keepdim=True)).sigmoid()
        a_c = self.excite(self.squeeze(rows.mean(2, keepdim=True)).relu()).sigmoid()
        return x * (a_h * a_c) * a_w


class P2P3Fusion(nn.Module):
    """D-FINE's cross-scale fusion (CCFM) for P2 and P3, with the paper's F = Conv1x1(P2 + Up(P3)) for its concatenation
    on the way down, and optionally DSAM on F. The paper prints a 3x3 convolution elsewhere; 1x1 is taken."""

    def __init__(self, config: DFineConfig, dsam: bool):
        super().__init__()
        width, blocks, act = config.encoder_hidden_dim, round(3 * config.depth_mult), config.activation_function
        self.lateral = DFineConvNormLayer(config, width, width, 1, 1)
        self.fuse = DFineConvNormLayer(config, width, width, 1, 1, activation=act)
        self.attention = DSAM(width) if dsam else nn.Identity()
        self.top_down = DFineRepNCSPELAN4(config, numb_blocks=blocks)
        self.top_down.conv1 = DFineConvNormLayer(config, width, 2 * width, 1, 1, activation=act)  # F, no concatenation
        self.down = DFineSCDown(config, 3, 2)
        self.bottom_up = DFineRepNCSPELAN4(config, numb_blocks=blocks)

    def forward(self, features: list[Tensor], **_) -> BaseModelOutput:
        p2, p3 = features
        p3 = self.lateral(p3)
        fused = self.fuse(p2 + F.interpolate(p3, scale_factor=2.0, mode="bilinear", align_corners=False))
        p2 = self.top_down(self.attention(fused))
        p3 = self.bottom_up(torch.cat([self.down(p2), p3], 1))
        return BaseModelOutput(last_hidden_state=[p2, p3])


class InAnchors(nn.Module):
    """A box head whose first two numbers move the centre by about one anchor's side each, as the last two (d w = w d logit)
    change the size: t = (x - x_a) / w_a as in R-CNN (Girshick et al. 2014, appendix C) and as D-FINE's own decoder layers
    measure edges in units of the box. The network is the same, only its centres learn no faster than its sizes: folded, the
    last layer holds the factor, as exported graphs have it.
    """

    def __init__(self, head: DFineMLP, side_px: float):
        super().__init__()
        self.layers = head.layers
        # The sigmoid's slope is 1/4 at the middle of the canvas.
        self.register_buffer("scale", torch.tensor([4 * side_px / FIXED_SIZE[1], 4 * side_px / FIXED_SIZE[0], 1.0, 1.0]))
        self.is_folded = False

    def fold(self, folded: bool) -> None:
        """Multiplies the factor into the last layer, or takes it out again."""
        if folded != self.is_folded:
            factor = self.scale if folded else 1 / self.scale
            with torch.no_grad():
                self.layers[-1].weight.mul_(factor[:, None])
                self.layers[-1].bias.mul_(factor)
            self.is_folded = folded

    def forward(self, x: Tensor) -> Tensor:
        *hidden, last = self.layers
        for layer in hidden:
            x = F.relu(layer(x))
        return last(x) if self.is_folded else last(x) * self.scale


def configuration(p2: bool, num_classes: int) -> DFineConfig:
    """D-FINE-N as released (dfine_hgnetv2_n_coco.yml), or its P2 + P3 cut."""
    stages = 2 if p2 else 4
    backbone = HGNetV2Config(
        stem_channels=[3, 16, 16],
        embedding_size=16,
        depths=[1, 1, 2, 1][:stages],
        hidden_sizes=[64, 256, 512, 1024][:stages],
        stage_in_channels=[16, 64, 256, 512][:stages],
        stage_mid_channels=[16, 32, 64, 128][:stages],
        stage_out_channels=[64, 256, 512, 1024][:stages],
        stage_num_blocks=[1, 1, 2, 1][:stages],
        stage_downsample=[False, True, True, True][:stages],
        stage_downsample_strides=[2] * stages,
        stage_light_block=[False, False, True, True][:stages],
        stage_kernel_size=[3, 3, 5, 5][:stages],
        stage_numb_of_layers=[3] * stages,
        use_learnable_affine_block=True,
        out_indices=[stages - 1, stages],
    )
    width = 64 if p2 else 128
    return DFineConfig(
        backbone_config=backbone,
        freeze_backbone_batch_norms=False,
        num_labels=num_classes,
        encoder_layers=0 if p2 else 1,
        encode_proj_layers=[] if p2 else [1],
        encoder_in_channels=[64, 256] if p2 else [512, 1024],
        feat_strides=[4, 8] if p2 else [16, 32],
        encoder_hidden_dim=width,
        d_model=width,
        encoder_ffn_dim=512,
        decoder_ffn_dim=2 * width if p2 else 4 * width,
        decoder_in_channels=[width, width],
        decoder_layers=3,
        decoder_n_points=[6, 6],
        num_feature_levels=2,
        depth_mult=0.5,
        hidden_expansion=1.0 if p2 else 0.34,
        num_queries=QUERIES,
        num_denoising=DENOISING_QUERIES,
        initializer_bias_prior_prob=SCORE_PRIOR,
        attn_implementation="eager",
    )


@torch.no_grad()
def initialise(model: DFineModel) -> None:
    """Weights to train from scratch, as the released code has them.

    `transformers` draws all from N(0, 0.01), fit to be overwritten by a checkpoint only.
    """
    decoder = model.decoder
    kept = {  # already set on purpose by transformers
        id(layer) for block in decoder.layers for layer in (block.gateway.gate, block.encoder_attn.sampling_offsets,
                                                            block.encoder_attn.attention_weights)
    }
    for module in model.modules():
        if isinstance(module, nn.Conv2d):
            module.reset_parameters()
        elif isinstance(module, nn.Linear) and id(module) not in kept:
            nn.init.xavier_uniform_(module.weight)
            nn.init.zeros_(module.bias)
    bias = -math.log((1 - SCORE_PRIOR) / SCORE_PRIOR)
    for head in (model.enc_score_head, *decoder.class_embed):
        nn.init.constant_(head.bias, bias)
    mlps = [model.enc_bbox_head, decoder.pre_bbox_head, *decoder.bbox_embed, *(q.reg_conf for q in decoder.lqe_layers)]
    for mlp in mlps:
        nn.init.zeros_(mlp.layers[-1].weight)


# --- Loss ------------------------------------------------------------------------------------------------------------


def nwd(a: Tensor, b: Tensor, c_px: float) -> Tensor:
    """Normalised Wasserstein distance exp(-W2 / C) of boxes cx, cy, w, h [..., 4] in pixels, 1 for equal boxes.

    W2 is the distance of the boxes' Gaussians, |(cx, cy, w/2, h/2)_a - (...)_b|.
    """
    halve = a.new_tensor([1.0, 1.0, 0.5, 0.5])
    squared = ((a - b) * halve).square().sum(-1)
    return torch.exp(-squared.clamp(min=1e-8).sqrt() / c_px)  # the floor (1e-4 px) keeps the slope finite


Matches = list[tuple[Tensor, Tensor]]  # per image: indices of queries, indices of their targets


class Criterion(DFineLoss):
    """D-FINE's criterion as released: matching, varifocal, regression, FGL and DDF (GO-LSD) over all decoder layers.

    The terms come from `transformers`; their assembly is here, since that of version 5.23 (a) shifts the intermediate
    boxes by one layer against the intermediate distributions, (b) leaves the last layer without FGL, (c) has no GO
    matching: boxes and distributions are to be trained on the union of the matches of all layers.
    """

    def __init__(self, config: DFineConfig, canvas: Canvas, nwd_px: float | None):
        super().__init__(config)
        self.canvas, self.nwd_px = canvas, nwd_px
        self.costs = (config.matcher_class_cost, config.matcher_bbox_cost, config.matcher_giou_cost)
        if nwd_px is not None:
            self.weight_dict |= {"loss_bbox": 0.0, "loss_giou": 0.0, "loss_nwd": NWD_WEIGHT}

    def nwd(self, a: Tensor, b: Tensor) -> Tensor:
        """NWD of boxes in units of the canvas."""
        h, w = self.canvas.size
        scale = a.new_tensor([w, h, w, h])
        return nwd(a * scale, b * scale, self.nwd_px)

    @torch.no_grad()
    def match(self, head: dict, targets: list[dict]) -> Matches:
        """Hungarian assignment, each image by itself: 2 focal + 5 L1 - 2 GIoU, or - 2 NWD."""
        out = []
        for logits, boxes, target in zip(head["logits"], head["pred_boxes"], targets):
            if len(target["boxes"]) == 0:
                out.append((torch.zeros(0, dtype=torch.int64),) * 2)
                continue
            p = logits[:, target["class_labels"]].sigmoid()
            negative = (1 - self.matcher.alpha) * p**self.matcher.gamma * -(1 - p + 1e-8).log()
            positive = self.matcher.alpha * (1 - p) ** self.matcher.gamma * -(p + 1e-8).log()
            distance = torch.cdist(boxes, target["boxes"], p=1)
            if self.nwd_px is None:
                likeness = generalized_box_iou(*map(center_to_corners_format, (boxes, target["boxes"])))
            else:
                likeness = self.nwd(boxes[:, None], target["boxes"][None])
            cost = self.costs[0] * (positive - negative) + self.costs[1] * distance - self.costs[2] * likeness
            rows, columns = linear_sum_assignment(cost.cpu().nan_to_num(1e6, 1e6, -1e6).numpy())
            out.append((torch.as_tensor(rows), torch.as_tensor(columns)))
        return out

    def loss_boxes(self, outputs: dict, targets: list[dict], indices: Matches, num_boxes: float) -> dict[str, Tensor]:
        if self.nwd_px is None:
            return super().loss_boxes(outputs, targets, indices, num_boxes)
        source = outputs["pred_boxes"][self._get_source_permutation_idx(indices)]
        target = torch.cat([t["boxes"][i] for t, (_, i) in zip(targets, indices)])
        return {"loss_nwd": (1 - self.nwd(source, target)).sum() / num_boxes}

    @staticmethod
    def union(matches: list[Matches]) -> Matches:
        """All layers' matches of each image together; a query with several targets keeps its most frequent one."""
        out = []
        for image in zip(*matches):
            pairs = torch.stack([torch.cat(side) for side in zip(*image)], 1)
            pairs, counts = pairs.unique(dim=0, return_counts=True)
            best = {}
            for query, target in pairs[counts.argsort(descending=True, stable=True)].tolist():
                best.setdefault(query, target)
            out.append(tuple(torch.tensor(list(side), dtype=torch.int64) for side in (best.keys(), best.values())))
        return out

    def forward(self, heads: list[dict], denoising: list[dict], meta: dict | None, targets: list[dict]) -> dict:
        """Weighted losses by name, summed over `heads` (decoder layers and proposals) and the denoising heads."""
        losses: dict[str, Tensor] = {}

        def add(terms: dict) -> None:
            for name, value in terms.items():
                name = name.removeprefix("loss_")
                losses[name] = losses.get(name, 0.0) + self.weight_dict[f"loss_{name}"] * value

        matches = [self.match(head, targets) for head in heads]
        union = self.union(matches)
        count = max(1.0, sum(len(t["boxes"]) for t in targets))
        union_count = max(1.0, sum(len(queries) for queries, _ in union))
        for head, indices in zip(heads, matches):
            add(self.loss_labels_vfl(head, targets, indices, count))
            add(self.loss_boxes(head, targets, union, union_count))
            add(self.loss_local(head, targets, union, union_count))
        if meta is not None:
            indices = self.get_cdn_matched_indices(meta, targets)
            for head in denoising:
                for term in (self.loss_labels_vfl, self.loss_boxes, self.loss_local):
                    add(term(head, targets, indices, count * meta["dn_num_group"]))
        return losses


# --- Detector --------------------------------------------------------------------------------------------------------


class DFineDetector(nn.Module):
    """A D-FINE row with the detectors' protocol: `loss` for training, `decode` for detection and export."""

    def __init__(self, name: str, num_classes: int = 8, mean_object_px: float = 14.0):
        if name not in NAMES:
            raise ValueError(f"no model {name!r}: choose one of {', '.join(NAMES)}")
        super().__init__()
        p2 = "-p2" in name
        self.name = name
        self.stride = 8 if p2 else 32
        self.min_side_px = 64 if p2 else 160  # at least as many proposals as queries
        self.fixed_size = FIXED_SIZE
        config = configuration(p2, num_classes)
        self.canvas = Canvas(mean_object_px)
        self.model = model = DFineModel(config)
        width, layers = config.d_model, config.decoder_layers
        bins = 4 * (config.max_num_bins + 1)
        model.decoder.class_embed = nn.ModuleList(nn.Linear(width, num_classes) for _ in range(layers))
        model.decoder.bbox_embed = nn.ModuleList(DFineMLP(width, width, bins, 3) for _ in range(layers))
        if p2:
            model.encoder = P2P3Fusion(config, dsam=name.endswith("-dsam"))
        else:
            model.encoder.aifi[0].position_embedding = CanvasPositions(width, self.canvas)
        initialise(model)
        model.enc_bbox_head = InAnchors(model.enc_bbox_head, mean_object_px)
        model.decoder.pre_bbox_head = InAnchors(model.decoder.pre_bbox_head, mean_object_px)
        model.generate_anchors = self.canvas.anchors
        for layer in model.decoder.layers:
            layer.encoder_attn.ms_deformable_attn_core = self.canvas.sample
        self.criterion = Criterion(config, self.canvas, mean_object_px if "-nwd" in name else None)

    def fold(self, folded: bool = True) -> None:
        """Brings the heads into the form that exported graphs have, or back into the one that learns."""
        for head in (self.model.enc_bbox_head, self.model.decoder.pre_bbox_head):
            head.fold(folded)

    def loss(self, images: Tensor, targets: list[dict]) -> dict[str, Tensor]:
        """Weighted scalar losses, and their sum as `total`.

        `images` [B,3,H,W], RGB 0..1, H and W multiples of `stride`; `targets`: per image `boxes` [n,4] xyxy in pixels
        and `labels` [n], n may be 0. Needs training mode.
        """
        if not self.training:
            raise RuntimeError("D-FINE's decoder gives its intermediate layers in training mode only: call .train()")
        self.canvas.anywhere(tuple(images.shape[-2:]))
        labels = []
        for target in targets:
            boxes = target["boxes"].to(images.device, torch.float32).reshape(-1, 4)
            classes = target["labels"].to(images.device, torch.int64)
            labels.append({"boxes": self.canvas.normalise(boxes), "class_labels": classes})
        out = self.model(images, labels=labels)
        meta = out.denoising_meta_values
        # The losses are in single precision whatever the net multiplies in.
        logits, boxes = out.intermediate_logits.float(), out.intermediate_reference_points.float().clamp(0, 1)
        corners, references = out.intermediate_predicted_corners.float(), out.initial_reference_points.float()

        def decoder_heads(queries: slice) -> list[dict]:
            """The decoder's layers, then its first guess, which has no distribution."""
            layers = [
                {
                    "logits": logits[:, i + 1, queries],
                    "pred_boxes": boxes[:, i + 1, queries],
                    "pred_corners": corners[:, i, queries],
                    "ref_points": references[:, i, queries],
                    "teacher_corners": corners[:, -1, queries],
                    "teacher_logits": logits[:, -1, queries],
                }
                for i in range(corners.shape[1])
            ]
            return [*layers, {"logits": logits[:, 0, queries], "pred_boxes": boxes[:, 0, queries]}]

        split = meta["dn_num_split"][0] if meta else 0
        proposals = {"logits": out.enc_topk_logits.float(), "pred_boxes": out.enc_topk_bboxes.float()}
        denoising = decoder_heads(slice(0, split)) if meta else []
        with torch.autocast(images.device.type, enabled=False):
            losses = self.criterion([*decoder_heads(slice(split, None)), proposals], denoising, meta, labels)
        return losses | {"total": sum(losses.values())}

    def decode(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Boxes [B,N,4] xyxy in pixels, scores [B,N] falling and labels int64 [B,N] of images [B,3,H,W], N = 100.

        The score is that of any UAV, or of anything else where that is likelier, 0 for a second box of one object. Needs evaluation mode.
        """
        self.canvas.whole(tuple(int(side) for side in images.shape[-2:]))
        out = self.model(images)
        labels, scores = any_of(out.intermediate_logits[:, -1].sigmoid())
        scores, order = scores.topk(QUERIES)
        boxes = self.canvas.pixels(out.intermediate_reference_points[:, -1].clamp(0, 1))
        boxes, labels = rows_at(boxes, order), rows_at(labels, order)
        scores, order = (scores * first_of_object(boxes)).topk(QUERIES)
        return rows_at(boxes, order), scores, rows_at(labels, order)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.decode(images)


def first_of_object(boxes: Tensor) -> Tensor:
    """1 for boxes [B,N,4], best first, that no better one overlaps by half (IoU), 0 for the others: [B,N].

    Trained to its end a set detector gives one box an object; before, it gives several, and each further one would be a
    false alarm and, in the loop, a track. All are compared at once (Fast NMS: Bolya et al., YOLACT, ICCV 2019).
    """
    overlap = box_iou_terms(boxes[:, :, None], boxes[:, None])[0]
    better = torch.ones_like(overlap[0]).tril(-1)
    return 1.0 - ((overlap > 0.5) * better).amax(-1)


def build_dfine(name: str, num_classes: int = 8, mean_object_px: float = 14.0) -> DFineDetector:
    """One of `NAMES` with random weights; `mean_object_px` is the anchors' side and NWD's constant C [px]."""
    return DFineDetector(name, num_classes, mean_object_px)
